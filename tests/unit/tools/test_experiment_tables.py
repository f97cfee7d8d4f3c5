"""Tables and curves with results that are calculated by hand, and the results folder."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE
from typing import Any

import pyarrow.parquet as pq
import pytest

from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan, FloorPlanError, parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from sim_device.world.world import World
from support.root import ROOT
from tools.dev import kernels
from tools.experiment import curves, report
from tools.experiment.compare_tables import shared, zimablue_table
from tools.experiment.cycles import PAPER_END_MM
from tools.experiment.figures import path_picture
from tools.experiment.layout_tables import range_table
from tools.experiment.paired_differences import difference, matched
from tools.experiment.paper_tables import (
    PAPER_SHARES,
    beside_rows,
    beside_table,
    cycle_spread,
    cycle_table,
)
from tools.experiment.paper_trials import RANGE_LEVEL, TOLERANCES, paper_trials
from tools.experiment.store import (
    LINES,
    ExperimentFolderError,
    Store,
    check_compiled,
    code_version,
)
from tools.experiment.tables import at_multiples, repeat_command, worst_table
from tools.experiment.trials import (
    OPEN_FLOOR,
    Trial,
    TrialKind,
    generated_rooms,
    grid_trials,
    room_of,
)
from tools.experiment.zimablue_run import enlarged
from tools.rooms.layouts import LAYOUT, LAYOUTS


def row(planner: str = "paper", seed: int = 0, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - any column
    shares = [0.1 * k for k in range(len(curves.MULTIPLES))]
    return {
        "kind": TrialKind.RUN,
        "room": "case-1",
        "robot": "",
        "robot_hash": "",
        "planner": planner,
        "noise": "typical",
        "seed": seed,
        "limit_s": 3600.0,
        "outcome": "complete",
        "mouth_sweepable": 0.9,
        "time_ratio": 2.0,
        "largest_hole_cm2": 20.0,
        "curve": {"coverage": shares, "by_path": shares},
    } | more


# ---- the paper ------------------------------------------------------------------------------


def test_the_papers_table_2_by_division() -> None:
    assert round(100 * PAPER_SHARES["case-1"][0], 2) == 94.66
    assert PAPER_END_MM == 7.0


def test_the_papers_own_trials() -> None:
    trials = paper_trials(3600.0)
    case_1 = [t for t in trials if (t.room, t.noise, t.kind) == ("case-1", "paper", TrialKind.RUN)]
    assert [t.seed for t in case_1] == [0, 1, 2, 3, 4]
    assert sum(t.kind is TrialKind.CYCLES for t in trials) == 20


def test_section_5_3_compares_the_papers_algorithm_with_others_at_equal_noise() -> None:
    rows = [
        row(room="comprehensive", noise="paper", body_free=0.90),
        row(room="comprehensive", noise="typical", body_free=0.50),
        row(room="case-1", noise="paper", body_free=0.40),
        row("random", kind=TrialKind.BESIDE, room="comprehensive", noise="paper", body_free=0.80),
    ]
    assert beside_rows(rows) == [rows[0], rows[3]]
    assert [line[:3] for line in beside_table(rows).rows] == [
        ("paper", "94.61", "90.00"),
        ("random", "not given", "80.00"),
    ]
    assert beside_rows(rows[:3]) == []
    titles = [table.title for table in report.all_tables(rows[3:], "rooms")]
    assert titles == [beside_table(rows).title], "these rows are in no table over all rooms"


def test_every_layout_is_a_room_of_plausible_size_in_which_the_robot_fits() -> None:
    assert len(LAYOUTS) == 11
    for name in LAYOUTS:
        plan = room_of(f"{LAYOUT}{name}")
        x0, y0, x1, y1 = plan.bounds()
        assert 3.0 <= min(x1 - x0, y1 - y0) <= max(x1 - x0, y1 - y0) <= 6.0
        World(plan, RobotModel())
        assert parse_floorplan(plan.to_json()) == plan
    with pytest.raises(FloorPlanError, match="no layout 'moat'"):
        room_of("layout:moat")


def test_the_cost_of_range_noise_is_the_difference() -> None:
    kind, reading = TrialKind.RANGES, next(iter(TOLERANCES))
    rows = [row(reading, kind=kind, noise="none", mouth_sweepable=0.9)] + [
        row(reading, seed, kind=kind, noise=RANGE_LEVEL.name, mouth_sweepable=share)
        for seed, share in enumerate((0.8, 0.9))
    ]
    assert range_table(rows).rows == [
        ("whole_step", "2 cm", "90.00", "85.00", "80.00 to 90.00", "5.00")
    ]


def test_the_u_shaped_cycles_have_a_picture_of_their_own_size() -> None:
    places = [[10.0, 10.0], [11.77, 10.0], [11.77, 10.16], [10.0, 10.16]]
    cycles = row("u-cycles", kind=TrialKind.CYCLES, room=OPEN_FLOOR, noise="paper", path=places)
    cycles |= {"path_m": 27.0, "duration_s": 160.0, "offsets": [{}] * 7}
    del cycles["mouth_sweepable"]
    assert "<svg" in path_picture(cycles)
    assert "<h2>Paths</h2>" in report.render("t", "c", [cycles | {"offsets": []}], [])


def test_quartiles_of_the_cycles() -> None:
    columns = ("offset_mm", "along_mm", "across_mm")
    runs = [
        {
            "path_m": 27.0,
            "offsets": [{"cycle": n} | dict.fromkeys(columns, mm) for n in range(1, 8)],
        }
        for mm in (1.0, 2.0, 3.0, 4.0, 5.0)
    ]
    assert cycle_spread(runs) == [(2.0, 3.0, 4.0)] * 7
    rows = cycle_table(runs).rows
    assert rows[0] == ("1", "3.0", "2.0 to 4.0", "+3.0", "+3.0", "")
    assert rows[6] == ("7", "3.0", "2.0 to 4.0", "+3.0", "+3.0", "7"), "the paper's seven cycles"


# ---- curves ---------------------------------------------------------------------------------


def test_a_straight_lane_by_time_and_by_path() -> None:
    side, model = 2.0, RobotModel()
    plan = FloorPlan("s", ((0, 0), (side, 0), (side, side), (0, side)), (), Pose2(0.5, 1.0, 0.0))
    meter = CoverageMeter(plan, model, 0.01)
    speed, way = 0.1, 1.0
    track = [(0.1 * k, 0.5 + 0.1 * k * speed, 1.0, 0.0) for k in range(round(10 * way / speed) + 1)]
    measured = meter.measure(track)
    area = (side - 0.16) ** 2 - (4 - math.pi) * 0.08**2
    share = way * model.cleaning_width_m / area
    by_path = curves.over_path(meter, measured, track)
    assert by_path[-1] == pytest.approx(share, rel=0.02)
    # the path is 0.047 of the reference path, and the curve is constant after its end
    assert by_path == [by_path[-1]] * len(by_path)
    assert curves.over_path(meter, measured, track, cut=True) == [None] * len(by_path)
    # half of the reference time is 53 s at cruise speed, and the run takes 10 s
    assert curves.over_time(meter, measured)[0] == pytest.approx(share, rel=0.02)
    assert curves.over_time(meter, measured, cut=True) == [None] * len(by_path)


def test_a_mean_is_not_reported_where_a_run_was_cut() -> None:
    whole, cut = row(), row(seed=1)
    cut["curve"] = {"coverage": [0.3, *[None] * (len(curves.MULTIPLES) - 1)]}
    cells = at_multiples([whole, cut], "coverage")
    assert cells[0] == "15.0"
    assert set(cells[1:]) == {"-"}


# ---- comparisons ----------------------------------------------------------------------------


def test_side_by_side_only_where_both_ran() -> None:
    theirs = row("zimablue bsa", kind=TrialKind.ZIMABLUE, noise="its own", scale=1.77)
    rows = [row(), row(seed=1), theirs]
    assert shared(rows) == [rows[0], theirs]
    table = zimablue_table(rows, "coverage")
    assert [line[0] for line in table.rows] == ["paper", "BSA (zimablue)"]
    assert "1.77 times" in table.note
    assert "zimablue's runs end at 6 times the reference time" in table.note


def test_an_enlarged_room_has_the_same_shape() -> None:
    plan = room_of("case-1")
    larger = enlarged(plan, 1.5)
    assert larger.bounds() == pytest.approx([1.5 * side for side in plan.bounds()])
    assert larger.start.theta_rad == plan.start.theta_rad
    assert (larger.start.x_m, larger.start.y_m) == pytest.approx(
        (1.5 * plan.start.x_m, 1.5 * plan.start.y_m)
    )
    pit = ((1.0, 1.0), (1.2, 1.0), (1.2, 1.2))
    solid = enlarged(replace(plan, cliffs=(pit,)), 2.0).obstacles[-1]
    assert solid == ((2.0, 2.0), (2.4, 2.0), (2.4, 2.4)), "zimablue has no cliffs"


def test_the_worst_run_comes_first_with_the_command_that_repeats_it() -> None:
    rows = [row(seed=seed, mouth_sweepable=0.9 + 0.01 * seed, time_ratio=seed) for seed in range(3)]
    rows.append(row(seed=7, room="generated:box:8", mouth_sweepable=0.5))
    lines = worst_table(rows, "out/rooms", count=2).rows
    assert [line[5] for line in lines if line[0] == "mouth share"] == ["7", "0"]
    assert [line[5] for line in lines if line[0] == "time ratio"] == ["2", "7"]
    assert lines[0][-1] == (
        "sweepctl simulate out/rooms/generated-box-8.json --planner paper --noise typical "
        "--seed 7 --max-time 3600"
    )


def test_a_random_path_is_repeated_without_its_own_limit() -> None:
    assert repeat_command(row(planner="random", seed=1, duration_s=2468.02), "") == (
        "sweepctl simulate case-1 --planner random --planner-option max_time_s=1e6 "
        "--noise typical --seed 1 --max-time 2468.02"
    )


def test_a_generated_room_is_the_same_each_time_and_a_wrong_name_is_reported() -> None:
    names = generated_rooms(9)
    assert names[0].split(":")[1] == names[8].split(":")[1]
    assert room_of(names[8]) == room_of(names[8]) != room_of(names[0])
    for wrong in ("generated:box:x", "generated:nothing:1", "generated:"):
        with pytest.raises(ValueError, match="no room"):
            room_of(wrong)


# ---- the folder -----------------------------------------------------------------------------


def test_a_line_cut_short_costs_only_its_own_trial(tmp_path: Path) -> None:
    trials = [Trial("case-1", "paper", "none", seed) for seed in range(3)]
    store = Store(tmp_path, "1")
    for trial in trials[:2]:
        store.add(trial, {"x": trial.seed})
    lines = tmp_path / LINES
    lines.write_bytes(lines.read_bytes()[:-9])
    again = Store(tmp_path, "1")
    assert again.missing(trials) == trials[1:]
    again.add(trials[2], {"x": 2})
    third = Store(tmp_path, "1")
    assert third.missing(trials) == [trials[1]]
    assert [found["x"] for found in third.rows(trials)] == [0, 2]


def test_results_of_other_code_or_another_time_limit_are_not_mixed(tmp_path: Path) -> None:
    trial = Trial("case-1", "paper", "none", 0, 60.0)
    Store(tmp_path, "1").add(trial, {})
    assert Store(tmp_path, "1").missing([Trial("case-1", "paper", "none", 0, 90.0)])
    with pytest.raises(ExperimentFolderError, match="choose another folder, or discard"):
        Store(tmp_path, "2")
    assert Store(tmp_path, "2", force=True).missing([trial]) == [trial]
    assert code_version() == code_version()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux")
def test_a_full_disk_is_named_with_the_folder(tmp_path: Path) -> None:
    store = Store(tmp_path, "1")
    (tmp_path / LINES).symlink_to("/dev/full")
    with pytest.raises(ExperimentFolderError, match=rf"cannot write {tmp_path}: No space left"):
        store.add(Trial("case-1", "paper", "none", 0, 60.0), {})


def test_a_changed_room_file_is_another_trial(tmp_path: Path) -> None:
    room = tmp_path / "room.json"
    keys = []
    for side in (2, 4):
        walls = [[0, 0], [side, 0], [side, side], [0, side]]
        room.write_text(json.dumps({"walls": walls, "start": [1, 1, 0]}))
        (trial,) = grid_trials([str(room)], ["paper"], ["none"], [0], None)
        keys.append(trial.key)
    assert keys[0] != keys[1]


def test_only_one_process_uses_a_folder(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom pathlib import Path\nfrom tools.experiment.store import Store\n"
        f"store = Store(Path({str(tmp_path)!r}), '1')\nprint('ready', flush=True)\n"
        "sys.stdin.read()"
    )
    words = [sys.executable, "-c", program]
    with subprocess.Popen(words, stdin=PIPE, stdout=PIPE, text=True, cwd=ROOT) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(ExperimentFolderError, match="another experiment uses"):
            Store(tmp_path, "1")
        other.communicate("")
    Store(tmp_path, "1")


def test_a_module_of_another_source_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    check_compiled()
    monkeypatch.setattr(kernels, "is_stale", lambda source: source.stem == "raster_kernel")
    with pytest.raises(ExperimentFolderError, match="raster_kernel: not compiled, or of another"):
        check_compiled()


def test_a_damaged_part_of_the_dataset_is_written_again(tmp_path: Path) -> None:
    trial = Trial("case-1", "paper", "none", 0)
    store = Store(tmp_path, "1")
    store.add(trial, {"x": 1.5})
    store.seal()
    (part,) = (tmp_path / "dataset").iterdir()
    part.write_bytes(part.read_bytes()[:100])
    (tmp_path / "dataset" / "_part-00001.parquet").write_bytes(b"unfinished")
    again = Store(tmp_path, "1")
    again.seal()
    assert pq.read_table(tmp_path / "dataset").column("x").to_pylist() == [1.5]


def test_runs_with_another_time_limit_are_no_pair() -> None:
    base = row() | {"max_time_s": None}
    assert len(matched([base], [base])) == 1
    assert matched([base | {"max_time_s": 10.0}], [base]) == []


def test_equal_differences_have_no_star() -> None:
    pairs = [({"x": 1.0}, {"x": 2.0})] * 2
    assert difference(pairs, "x").text() == "+1.00 ± 0.00"


def test_a_room_file_in_a_folder_with_a_colon_is_no_generated_room() -> None:
    command = repeat_command(row(room="12:30/room.json"), "rooms")
    assert "simulate 12:30/room.json " in command
    made = repeat_command(row(room="generated:box:1", robot="a/b.toml", robot_hash="12ab"), "rooms")
    assert "simulate rooms/generated-box-1-b-12ab.json " in made


def test_a_long_report_has_the_pictures_of_the_worst_runs() -> None:
    path = [(0.0, 0.0), (1.0, 0.0)]
    shares = [0.1] * len(curves.MULTIPLES)
    curve = {"coverage": shares, "by_path": shares, "by_energy": shares}
    rows = [
        row(room=f"generated:box:{n}", mouth_sweepable=0.5 + 0.001 * n, path=path, curve=curve)
        for n in range(80)
    ]
    long, short = (report.render("t", "c", some, []) for some in (rows, rows[:60]))
    assert "The 60 first seeds with the lowest coverage" in long
    assert "The 60 first seeds" not in short
    assert long.count("<svg") == short.count("<svg") > 60


def test_a_page_holds_no_text_as_markup_and_markdown_every_cell() -> None:
    made = report.all_tables([row("zimablue bsa", kind=TrialKind.ZIMABLUE)], "rooms")
    assert made == []
    page = report.render("a < b", "sweepctl 'x<y>'", [], made)
    assert "a &lt; b" in page
    assert "x<y>" not in page
    table = worst_table([row()], "rooms")
    text = report.markdown([table])
    assert len([line for line in text.splitlines() if line.startswith("|")]) == 2 + len(table.rows)
    json.dumps(table.rows)
