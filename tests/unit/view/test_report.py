"""The report of a run agrees with its log and its summary."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
from matplotlib.image import imread

from bridge.record.reader import LogReader
from bridge.view.report.drawing import blank
from bridge.view.report.figures import draw_bounds, room_height
from bridge.view.report.report import render
from bridge.view.report.run_data import RunData, load_run
from bridge.view.report.tables import holes
from support.cli import case_1, plain_messages, short_runs, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done

pytestmark = pytest.mark.slow


class Page(HTMLParser):
    """The text of a page, and the resources that the page would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.fetched: list[str] = []
        self.svgs = 0
        self.open_tags: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.svgs += tag == "svg"
        for name, value in attrs:
            if (
                name in {"src", "href", "xlink:href", "data"}
                and value
                and not value.startswith(("#", "data:"))
            ):
                self.fetched.append(value)

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


class Reported(NamedTuple):
    """A run in the paper's case 1 and its report, shared by all tests."""

    summary_json: dict[str, Any]
    """Summary of the run."""
    data: RunData
    html: Path
    png: Path
    done: Done


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Reported:
    run, folder = case_1(tmp_path_factory), tmp_path_factory.mktemp("report")
    html, png = folder / "new" / "run.html", folder / "run.png"
    kept = []

    def keeping(path: Path) -> RunData:
        kept.append(load_run(path))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bridge.view.report.report.load_run", keeping)
        done = sweepctl("report", run.log, "--out", html, "--png", png, "--json")
    assert done.status == 0, done.err
    return Reported(run.done.json, kept[0], html, png, done)


def test_a_whole_run(reported: Reported) -> None:
    summary_json, data, html, png, done = reported
    assert done.json["report"] == str(html)
    assert data.whole
    page = Page(html.read_text())
    assert page.fetched == [], "the page loads no other files"
    assert "@import" not in html.read_text()
    assert "url(" not in re.sub(r"url\(#", "", html.read_text()), "the styles load no other files"
    assert page.svgs >= 5
    for words in (
        "Sweeping case-1, planner paper, seed 1",
        "The run was completed",
        summary_json["reason"],
        f"{summary_json['path_m']:.1f} m",
        f"{100 * summary_json['coverage']['mouth_sweepable']:.1f} %",
        f"{100 * summary_json['coverage']['body_free']:.2f} %",
        "94.66 % (Table 2",
        "Coverage against time",
        "Unswept floor",
        "Faults and events",
        f"{summary_json['energy_wh']:.2f} Wh",
        "run is driving",
        "none was lost",
        "Simulated in virtual time",
    ):
        assert words in page.text, words
    picture = imread(png)
    assert picture.shape[0] > 900
    assert picture[..., :3].std() > 0.05, "the picture is not empty"


def test_a_bound_is_named_apart_from_a_reference(reported: Reported) -> None:
    report, model = reported.data.coverage, reported.data.track.model
    assert report is not None
    area_m2, width_m = report.sweepable_m2, model.cleaning_width_m
    bound_s = area_m2 / (width_m * model.max_speed_m_s)
    reference_s = area_m2 / (width_m * model.cruise_speed_m_s)
    text = Page(reported.html.read_text()).text
    assert f"needs at least {bound_s:.0f} s to sweep that floor" in text
    assert f"lower bound: top speed, no overlap ({bound_s:.0f} s)" in legend(reported.data)
    assert f"bound {bound_s:.0f} s at top speed, reference {reference_s:.0f} s at cruise" in text
    assert f"bound {0.9 * bound_s:.0f} s and {0.99 * bound_s:.0f} s" in text
    assert f"reference {area_m2 / width_m:.1f} m" in text
    ratio = f"{report.time_ratio:.2f} times as long"
    sentence = f"without turns or overlap, is {reference_s:.0f} s. The run took {ratio}"
    # The ratio is misleading if more than a tenth of the floor is unswept.
    assert (sentence in text) == (report.coverage.mouth_sweepable >= 0.9)


def legend(data: RunData) -> list[str]:
    axes = blank(4.0, 3.0).add_subplot()
    draw_bounds(axes, data, None)
    return [str(label) for label in axes.get_legend_handles_labels()[1]]


def test_figures_are_those_of_the_summary(reported: Reported) -> None:
    data, summary_json = reported.data, reported.summary_json
    assert data.coverage is not None
    for name, share in data.coverage.coverage.to_dict().items():
        if name != "eq8":
            assert share == pytest.approx(summary_json["coverage"][name], abs=2e-3)
    assert data.coverage.t90_s == pytest.approx(summary_json["t90_s"], abs=0.5)
    assert data.coverage.largest_hole_cm2 == pytest.approx(
        summary_json["largest_hole_cm2"], rel=0.05
    )
    found = holes(data)
    assert found[0].area_cm2 == pytest.approx(summary_json["largest_hole_cm2"], rel=0.05)
    assert [h.area_cm2 for h in found] == sorted((h.area_cm2 for h in found), reverse=True)
    assert max(h.inradius_m for h in found) == pytest.approx(
        summary_json["hole_inradius_m"], abs=0.003
    )
    assert data.figure("energy_wh") == summary_json["energy_wh"]
    assert 0 < (data.motor_wh or 0) < summary_json["energy_wh"]
    assert max(e for _, e in data.pose_error) == pytest.approx(
        summary_json["pose_error_m"]["max"], abs=2e-3
    )


def test_a_room_has_a_figure_of_its_own_shape(reported: Reported) -> None:
    track = reported.data.track
    known = track.plan
    assert known is not None

    def height(width_m: float, depth_m: float) -> float:
        walls = ((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m))
        plan = replace(known, walls=walls)
        data = replace(reported.data, track=replace(track, plan=plan))
        return room_height(data, 6.0)

    assert height(3.0, 3.0) == pytest.approx(7.0)  # plus one inch for legend and axis
    assert height(6.0, 3.0) == pytest.approx(4.0)
    assert height(30.0, 1.0) == 2.6, "the minimum height keeps a corridor readable"
    assert height(1.0, 30.0) == 9.0


def test_streams_and_losses_are_counted(tmp_path: Path) -> None:
    log = tmp_path / "lossy.mcap"
    done = sweepctl(
        *("simulate", "empty", "--planner", "u-shape", "--max-time", "9", "--out", log, "--json"),
        *("--fault", "byte-loss@3:4:rate=0.002,way=up", "--fault", "silence@7.5:0.4:way=up"),
    )
    data = load_run(log)
    imu = data.streams["imu"]
    assert imu.count == len(plain_messages(log, "/device/imu"))
    assert imu.longest_s == pytest.approx(0.4, abs=0.1)
    assert imu.gaps >= 1
    assert data.lost == pytest.approx(done.json["wire"]["lost"], abs=3)
    assert data.lost > 10
    assert data.damaged > 5
    text = Page(render(data, holes(data))).text
    assert "Injected faults: byte-loss@3:4:rate=0.002,way=up silence@7.5" in text
    assert "reached its time limit" in text


def test_a_log_without_its_end(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    whole = short_runs(tmp_path_factory)[0].log.read_bytes()
    log = tmp_path / "cut.mcap"
    log.write_bytes(whole[: len(whole) * 2 // 3])
    assert sweepctl("report", log).status == 0
    text = Page((tmp_path / "cut.html").read_text()).text
    assert "its writer was killed or lost power" in text
    assert "no, its end is missing" in text
    truth = LogReader(log).messages({"/truth/pose"})
    ways = [(m.decoded.pose.position.x, m.decoded.pose.position.y) for m in truth]
    length_m = sum(math.dist(a, b) for a, b in pairwise(ways))
    assert f"{length_m:.1f} m path, from the recorded poses" in text
    again = sweepctl("report", log)
    assert again.status == 1
    assert "--force" in again.line
    page, png = (tmp_path / "cut.html").read_bytes(), tmp_path / "cut.png"
    (tmp_path / "cut.html").write_bytes(page + b"mine")
    pictured = sweepctl("report", log, "--png", png, "--json")  # only the picture is new
    assert pictured.status == 0
    assert (pictured.json["report"], pictured.json["png"]) == (None, str(png))
    assert png.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "cut.html").read_bytes() == page + b"mine", "the existing page is unchanged"
    assert sweepctl("report", log, "--png", png).status == 1, "the picture exists too"


def test_a_capture_without_room_or_summary(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = short_runs(tmp_path_factory)[0].log
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(m.decoded.data for m in LogReader(log).messages({"/raw/uart/rx"})))
    png = tmp_path / "capture.png"
    done = sweepctl("report", capture, "--out", tmp_path / "capture.html", "--png", png)
    assert done.status == 0, done.err
    text = Page((tmp_path / "capture.html").read_text()).text
    assert "The room is unknown, so the coverage is unknown as well" in text
    assert "swept floor follows" not in text, "no floor is drawn"
    assert png.read_bytes().startswith(b"\x89PNG")


def test_no_log(tmp_path: Path) -> None:
    done = sweepctl("report", tmp_path / "none.mcap")
    assert done.status == 1
    assert "none.mcap" in done.line
    assert not (tmp_path / "none.html").exists()
