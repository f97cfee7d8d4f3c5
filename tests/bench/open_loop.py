"""Open-loop replay of a run's recorded inputs through the C core and the model in Python.

    PYTHONPATH=tests python -m bench.open_loop
    PYTHONPATH=tests python -m bench.open_loop case-2 --link can --seconds 120 --fault reset@20

A run with ``--target core`` is recorded at the interface between firmware and board: received bytes
with their times, encoder counts, registers of the IMU, ranges, contacts, readings of the ADC. Then
both firmwares get the recorded inputs. The command prints each field that differs, with its bound
and the bound's cause. The status is 1 if a difference exceeds its bound.
"""

from __future__ import annotations

import argparse
import sys

from support.recording_comparison import compare_recorded, lines, record_run


def main() -> int:
    """Record, replay and compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("room", nargs="?", default="case-1")
    parser.add_argument("--link", choices=["uart", "can"], default="uart")
    parser.add_argument("--seconds", type=float, default=600.0, help="simulated time limit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise", default="typical")
    parser.add_argument("--fault", action="append", default=[], help="as in `simulate`")
    asked = parser.parse_args()
    recording = record_run(
        asked.room,
        can=asked.link == "can",
        max_time_s=asked.seconds,
        seed=asked.seed,
        noise=asked.noise,
        faults=asked.fault,
    )
    made = compare_recorded(recording)
    print(*lines(made), sep="\n")
    return 0 if made.exact and not made.unexplained else 1


if __name__ == "__main__":
    sys.exit(main())
