"""Comparisons of planners, with results that are calculated by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tools.experiment import figures, report
from tools.experiment.curves import MULTIPLES
from tools.experiment.planner_pairs import planner_pairs_table
from tools.experiment.tables import curve_table, energy_table
from tools.experiment.trials import TrialKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pytest
    from matplotlib.figure import Figure

LAST = len(MULTIPLES) - 1


def share(**at: float | None) -> list[float | None]:
    """Return a curve with the value ``rest``, except at given multiples (``x1_5`` for 1.5)."""
    rest = at.pop("rest")
    curve = dict.fromkeys(MULTIPLES, rest)
    curve |= {float(name[1:].replace("_", ".")): value for name, value in at.items()}
    assert len(curve) == len(MULTIPLES)
    return list(curve.values())


def row(
    planner: str,
    by_time: Sequence[float | None],
    by_energy: Sequence[float | None] = (),
    **more: Any,  # noqa: ANN401 - any column
) -> dict[str, Any]:
    return {
        "kind": TrialKind.RUN,
        "room": "case-1",
        "robot": "",
        "robot_hash": "",
        "planner": planner,
        "noise": "typical",
        "seed": 0,
        "limit_s": 3600.0,
        "duration_s": 900.0,
        "outcome": "complete",
        "sweepable_m2": 2.0,
        "reference_energy_wh": 0.05,
        "curve": {"coverage": by_time, "by_path": by_time, "by_energy": by_energy or by_time},
    } | more


# ---- energy -----------------------------------------------------------------------------------


def test_coverage_at_equal_energy_is_a_mean_over_all_runs() -> None:
    done = row("paper", share(rest=0.9), share(rest=0.6, x0_5=0.2))
    rows = [done, row("paper", share(rest=0.9), share(rest=0.8, x0_5=0.3, x8=None), seed=1)]
    table = curve_table(rows, "by_energy")
    assert table.rows == [("paper", "typical", "2", "25.0", *["70.0"] * 9, "-")]
    assert "25.0 mWh/m²" in table.note  # 50 mWh over 2 m²
    assert curve_table(rows).rows[0][3:] == ("90.0",) * 11


def test_energy_to_a_share_is_over_all_runs_and_not_over_those_that_reached_it() -> None:
    def run(planner: str, seed: int, end: float, room_wh: float) -> dict[str, Any]:
        shares = share(rest=end, x0_5=0.5 * end)
        drawn = [0.5 * room_wh] + [room_wh] * LAST
        return row(planner, shares, seed=seed) | {
            "curve": {"coverage": shares, "energy_wh": drawn},
        }

    # two of three runs end below 80 %, so there is no median
    poor = [run("u-shape", seed, end, 0.04) for seed, end in enumerate((0.8, 0.6, 0.6))]
    good = [run("recovery", seed, 1.0, 0.1 * (seed + 1)) for seed in range(3)]
    table = energy_table([*poor, *good], (0.5, 0.8))
    assert table.rows == [
        # a run that ends at 60 % has 50 % at 20 mWh + 2/3 · 20 mWh, over 2 m²
        ("u-shape", "typical", "3", "16.7 (100 %)", "- (33 %)"),
        # the median run has 50 % at 100 mWh and 80 % at 100 + 0.6 · 100 mWh, over 2 m²
        ("recovery", "typical", "3", "50.0 (100 %)", "80.0 (100 %)"),
    ]


# ---- run by run -------------------------------------------------------------------------------


def test_run_by_run_by_hand() -> None:
    rows = [
        row("recovery", share(rest=0.99, x1=0.4, x1_5=0.70)),
        row("recovery", share(rest=0.98, x1=0.4, x1_5=0.85), seed=1),
        row("paper", share(rest=0.90, x1=0.6, x1_5=0.75)),
        row("paper", share(rest=0.98, x1=0.6, x1_5=0.60), seed=1),
        row("paper", share(rest=1.00), seed=2),  # recovery has no run with this seed or room
        row("paper", share(rest=1.00), room="case-2"),
        row("random", share(rest=0.50, x8=0.995)),
        row("random", share(rest=0.30, x8=None), seed=1),
    ]
    table = planner_pairs_table(rows, "coverage", "recovery")
    assert table.head == (
        *("recovery against", "noise", "pairs"),
        *("1.5x", "2x", "2.5x", "3x", "3.5x", "4x", "5x", "6x", "8x"),
    )
    # no values before 1.5x; equal runs are not behind; a dash if a pair has an unknown value
    assert table.rows == [
        ("paper", "typical", "2", "1 (-5.0)", *["0 (+0.0)"] * 8),
        ("random", "typical", "2", "0 (+20.0)", *["0 (+49.0)"] * 7, "-"),
    ]


def test_run_by_run_at_equal_energy_is_another_table() -> None:
    rows = [
        row("recovery", share(rest=0.9), share(rest=0.7)),
        row("u-shape", share(rest=0.5), share(rest=0.8)),
        row("zimablue bsa", share(rest=0.5), kind=TrialKind.ZIMABLUE, noise="its own"),
    ]
    del rows[2]["curve"]["by_energy"]
    (line,) = planner_pairs_table(rows, "by_energy", "recovery").rows
    assert line == ("u-shape", "typical", "1", *["1 (-10.0)"] * 9)
    assert [line[3] for line in planner_pairs_table(rows, "coverage", "recovery").rows] == [
        "0 (+40.0)",
        "0 (+40.0)",
    ]


def test_without_noise_one_run_stands_for_every_seed() -> None:
    rows = [
        row("recovery", share(rest=0.9), noise="none"),
        row("recovery", share(rest=0.9), noise="typical"),
        *(row("random", share(rest=0.1 * n), noise="none", seed=n) for n in range(3)),
        *(row("random", share(rest=0.1 * n), noise="typical", seed=n) for n in range(3)),
    ]
    lines = planner_pairs_table(rows, "coverage", "recovery").rows
    assert [line[:4] for line in lines] == [
        ("random", "none", "3", "0 (+70.0)"),
        ("random", "typical", "1", "0 (+90.0)"),
    ]


def test_zimablues_runs_stand_beside_ours_of_each_level() -> None:
    rows = [
        row("recovery", share(rest=0.9)),
        row("recovery", share(rest=0.7), noise="harsh"),
        row("zimablue bsa", share(rest=0.8), kind=TrialKind.ZIMABLUE, noise="its own"),
    ]
    table = planner_pairs_table(rows, "coverage", "recovery")
    assert [line[:4] for line in table.rows] == [
        ("BSA (zimablue)", "typical", "1", "0 (+10.0)"),
        ("BSA (zimablue)", "harsh", "1", "1 (-10.0)"),
    ]
    assert "their own noise" in table.note


def test_nothing_to_pair_gives_no_table() -> None:
    alone = planner_pairs_table([row("recovery", share(rest=0.9))], "coverage", "recovery")
    other = planner_pairs_table([row("paper", share(rest=0.9))], "coverage", "recovery")
    assert alone.rows == other.rows == []


# ---- in the report ----------------------------------------------------------------------------


def figure_rows() -> list[dict[str, Any]]:
    figured = {"mouth_sweepable": 0.9, "time_ratio": 2.0, "path_ratio": 2.0, "collisions": 0}
    energy = {"energy_wh": [0.1] * len(MULTIPLES)}
    rows = [
        row("recovery", share(rest=0.9), share(rest=0.7), **figured),
        row("random", share(rest=0.5, x8=None), share(rest=0.4, x6=None, x8=None), **figured),
    ]
    for made in rows:
        made["curve"] |= energy
    return rows


def test_the_report_has_both_curves_and_both_pairings() -> None:
    titles = [table.title for table in report.all_tables(figure_rows(), "rooms")]
    for title in (
        "Coverage against time",
        "Coverage against energy",
        "recovery run by run, at equal time",
        "recovery run by run, at equal energy",
    ):
        assert titles.count(title) == 1


def test_the_energy_figure_is_at_equal_energies_and_ends_where_a_run_was_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[Figure] = []

    def keep(figure: Figure) -> str:
        drawn.append(figure)
        return ""

    monkeypatch.setattr(figures, "as_svg", keep)
    figures.coverage_curves(figure_rows(), "typical")
    lines = [
        [tuple(np.asarray(line.get_xydata()).T.tolist()) for line in axes.lines]
        for axes in drawn[0].axes
    ]
    assert lines == [
        [
            ([0, *MULTIPLES], [0, *[90.0] * 11]),
            ([0, *MULTIPLES[:-1]], [0, *[50.0] * 10]),
        ],
        [
            ([0, *MULTIPLES], [0, *[70.0] * 11]),
            ([0, *MULTIPLES[:-2]], [0, *[40.0] * 9]),
        ],
    ]
