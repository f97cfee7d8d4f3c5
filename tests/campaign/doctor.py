"""The findings of the doctor for every fault of the emulator.

    PYTHONPATH=tests python -m campaign.doctor --out docs/doctor-confusion.md

Each subject has one fault, injected into a recording of the whole link in virtual time. In half of
the subjects the robot stands still, in the others it drives a plan. The campaign counts the
findings: correct, a consequence of the fault, wrong, or none. With ``--keep FILE`` an interrupted
campaign continues.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from campaign.kept import Kept, stored_results
from protocol.messages.device import Power
from sim_device.faults.kinds import KINDS
from sim_device.line.line import LineSettings
from support.doctor_cases import DoctorCase, examine
from support.peers import catalogue, longer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


@dataclass(frozen=True)
class CampaignCase:
    """A case, its correct findings, and the findings that may accompany them."""

    case: DoctorCase
    right: frozenset[str]
    beside: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.case.name


def _subject(  # noqa: PLR0913 - the fault, and the case
    name: str,
    right: str,
    *faults: str,
    beside: str = "",
    moving: bool = False,
    seconds: float = 20.0,
    line: LineSettings | None = None,
    stalls: tuple[tuple[float, float], ...] = (),
    other: bool = False,
) -> CampaignCase:
    case = DoctorCase(
        name,
        faults,
        line or LineSettings(),
        seconds,
        moving,
        stalls,
        catalogue(more=[longer(Power)]) if other else None,
    )
    return CampaignCase(case, frozenset(right.split()), frozenset(beside.split()))


BUS = LineSettings(0, 0, 500_000)
"""A CAN bus at the usual bit rate."""
_STOPPED = "stopped"
SUBJECTS: tuple[CampaignCase, ...] = (
    _subject("no fault, standing", ""),
    _subject("no fault, for five seconds", "", seconds=4.8),
    _subject("no fault, driving", "", moving=True, seconds=60.0),
    _subject("no fault, a whole room", "", moving=True, seconds=300.0),
    _subject(
        "bit-flips", "line_noise", "bit-flips@5:10:rate=0.001", beside="device_receives_noise"
    ),
    _subject("byte-loss", "overrun", "byte-loss@5:10:rate=0.001", beside="device_receives_noise"),
    _subject("bursts", "line_noise", "bursts@5:12:rate=0.0007", beside="device_receives_noise"),
    _subject("duplicates", "repeated", "duplicates@5:10", beside="device_receives_noise"),
    _subject("latency", "latency", "latency@8:10:ms=40"),
    _subject("jitter", "latency", "jitter@4:15:ms=15"),
    _subject("silence", "gap", "silence@8:0.7:way=up"),
    _subject("wrong-baud, always", "wrong_baud", "wrong-baud@0"),
    _subject("wrong-baud, for a while", "wrong_baud", "wrong-baud@8:3", beside="gap"),
    _subject("unplug", "gap unplugged", "unplug@8:2"),
    _subject("no fault, on a bus", "", moving=True, seconds=30.0, line=BUS),
    _subject("no fault, on a bus, standing", "", line=BUS),
    _subject("can-bus-off, standing", "bus_off gap", "can-bus-off@8:0.5", line=BUS),
    _subject(
        "can-bus-off", "bus_off gap", "can-bus-off@12:0.6", moving=True, seconds=30.0, line=BUS
    ),
    _subject("reset", "reset", "reset@8:cause=pin"),
    _subject("hang", "watchdog", "hang@8"),
    _subject("crash", "crash", "crash@8"),
    _subject("hse-failed", "oscillator", "hse-failed@8", beside="crash clock_step clock_drift"),
    _subject("brown-out", "brown_out", "brown-out@8:off=0.5"),
    _subject("clock-drift", "clock_drift", "clock-drift@0:ppm=600"),
    _subject("clock-drift, five seconds", "clock_drift", "clock-drift@0:ppm=495", seconds=4.8),
    _subject("clock slow, five seconds", "clock_drift", "clock-drift@0:ppm=-495", seconds=4.8),
    _subject("clock-drift of a crystal", "", "clock-drift@0:ppm=100"),
    _subject("clock-jump, back", "clock_step", "clock-jump@10:ms=-50"),
    _subject("clock-jump, ahead", "clock_step", "clock-jump@10:ms=100"),
    _subject("adapter at 16 ms", "adapter_latency", line=LineSettings(921_600, 16_000)),
    _subject("baud too low", "overrun", line=LineSettings(38_400, 1000), beside="latency"),
    _subject("host held up", "host_stall", stalls=((8.0, 0.4), (12.0, 0.25))),
    _subject("another catalogue", "schema", other=True),
    _subject("imu-frozen, standing", "imu sensor", "imu-frozen@8:8"),
    _subject("imu-biased, standing", "imu", "imu-biased@8:12:gyro=3"),
    _subject("i2c-stuck, standing", "sensor", "i2c-stuck@8:8"),
    _subject("imu-clock", "", "imu-clock@0:percent=-1"),
    _subject("adc-frozen", "adc", "adc-frozen@8", moving=True, seconds=30.0),
    _subject(
        *("encoder-reversed", "sensor", "encoder-reversed@12"),
        moving=True,
        seconds=30.0,
        beside=f"slip {_STOPPED}",
    ),
    _subject(
        *("encoder-swapped", "sensor", "encoder-swapped@12"),
        moving=True,
        seconds=30.0,
        beside=f"slip {_STOPPED}",
    ),
    _subject(
        "imu-frozen", "imu sensor", "imu-frozen@12:10", moving=True, seconds=30.0, beside="slip"
    ),
    _subject("imu-biased", "slip imu", "imu-biased@12:25:gyro=6", moving=True, seconds=40.0),
    _subject("leaning", "tilt imu", "imu-biased@12:10:gyro=0,accel=0.3", moving=True, seconds=30.0),
    _subject(
        "encoder-dropout",
        "slip sensor",
        "encoder-dropout@12:15:share=0.4",
        moving=True,
        seconds=30.0,
        beside="bump",  # the robot leaves its path and collides with known obstacles
    ),
    _subject(
        *("wheel-stuck", "stall", "wheel-stuck@12:4"),
        moving=True,
        seconds=25.0,
        beside=f"slip {_STOPPED}",  # the device may latch a stop because of the motor's current
    ),
    _subject("wheel-slip", "slip", "wheel-slip@10:35:share=0.4", moving=True, seconds=50.0),
    _subject(
        "ultrasonic-blind",
        "sensor",
        "ultrasonic-blind@8:80",
        moving=True,
        seconds=90.0,
        beside="slip",
    ),
    _subject(
        "ultrasonic-constant",
        "slip sensor",
        "ultrasonic-constant@10:30:m=1.5",
        moving=True,
        seconds=45.0,
    ),
    _subject("bumper-stuck", "bump", "bumper-stuck@12:15", moving=True, seconds=30.0),
    _subject(
        *("battery-flat", "battery", "battery-flat@12:charge=0.02"),
        moving=True,
        seconds=25.0,
        beside=_STOPPED,
    ),
    _subject(
        "lifted", "lifted", "lifted@12:3", moving=True, seconds=25.0, beside=f"cliff {_STOPPED}"
    ),
    _subject(
        "carried", "lifted", "carried@12:3", moving=True, seconds=25.0, beside=f"cliff {_STOPPED}"
    ),
    _subject("displaced", "", "displaced@12", moving=True, seconds=25.0),
    _subject("obstacle", "", "obstacle@12:index=0,dx=0.3", moving=True, seconds=30.0),
    _subject("person", "", "person@12:15:ahead=0.5", moving=True, seconds=30.0),
)


@dataclass
class Result:
    """Findings for one subject and seed."""

    subject: CampaignCase
    seed: int
    found: list[str]

    @property
    def hit(self) -> bool:
        """Whether a finding is correct; without a fault, whether there is no finding."""
        right = self.subject.right
        return bool(right & set(self.found)) if right else not self.found

    @property
    def wrong(self) -> list[str]:
        """Wrong findings."""
        return sorted(set(self.found) - self.subject.right - self.subject.beside)


def case(subject: CampaignCase, seed: int) -> Result:
    """Examine one subject."""
    findings = examine(subject.case, seed).conclude()
    return Result(subject, seed, [finding.kind for finding in findings])


def _examine_one(job: tuple[int, int]) -> list[str]:
    return case(SUBJECTS[job[0]], job[1]).found


def uncovered() -> set[str]:
    """Return the faults of the emulator that no subject covers."""
    had = {text.partition("@")[0] for subject in SUBJECTS for text in subject.case.faults}
    return set(KINDS) - had


def report(results: Iterable[Result]) -> tuple[str, bool]:
    """Return the page, and whether every finding is correct."""
    by_name: dict[str, list[Result]] = {}
    for result in results:
        by_name.setdefault(result.subject.name, []).append(result)
    kinds = sorted({kind for found in by_name.values() for r in found for kind in r.found})
    lines = [
        "# Findings of the doctor by fault",
        "",
        "<!-- Written by `python -m campaign.doctor` in tests/. -->",
        "",
        "This page shows which findings [`sweepctl doctor`](doctor.md) reports for which fault.",
        "",
        "Each row is a fault of the virtual sweeper or its serial link, with several seeds. Each",
        "column is a finding. A number counts the runs with that finding:",
        "",
        "- **bold**: correct",
        "- plain: a consequence of the fault",
        "- ~~struck~~: wrong",
        "",
        "*Driving* marks a run with a planner. In the other rows the robot stands still.",
        "",
        f"| fault | runs | {' | '.join(kinds)} | nothing |",
        f"|---|---|{'---|' * len(kinds)}---|",
    ]
    hits = wrong = total = 0
    for name, found in by_name.items():
        subject = found[0].subject
        counts = Counter(kind for r in found for kind in set(r.found))
        nothing = sum(not r.found for r in found)
        hits += sum(r.hit for r in found)
        wrong += sum(bool(r.wrong) for r in found)
        total += len(found)
        cells = [_cell(counts[kind], kind, subject) for kind in kinds]
        none = f"**{nothing}**" if nothing and not subject.right else str(nothing or "")
        how = f"{name} *driving*" if subject.case.moving else name
        lines.append(f"| {how} | {len(found)} | {' | '.join(cells)} | {none} |")
    lines += [
        "",
        f"{total} runs: {hits} with the correct finding, {wrong} with a wrong one.",
        "",
    ]
    return "\n".join(lines), hits == total and wrong == 0


def _cell(count: int, kind: str, subject: CampaignCase) -> str:
    if not count:
        return ""
    if kind in subject.right:
        return f"**{count}**"
    return str(count) if kind in subject.beside else f"~~{count}~~"


def results_of(jobs: list[tuple[int, int]], kept: Kept, processes: int) -> Iterator[Result]:
    """Yield the result of every subject and seed, in order."""
    named = {f"{SUBJECTS[i].name}, seed {seed}": (i, seed) for i, seed in jobs}
    stored = stored_results(_examine_one, named, kept, processes)
    for (i, seed), kinds in zip(jobs, stored, strict=True):
        yield Result(SUBJECTS[i], seed, kinds)


def main() -> int:
    """Examine all subjects and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=21)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument(
        "--keep", type=Path, help="results file; its results are not computed again"
    )
    parser.add_argument("--out", type=Path, help="write the page")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    jobs = [(i, seed) for i in range(len(SUBJECTS)) for seed in seeds]
    results = list(results_of(jobs, Kept(options.keep), options.jobs))
    for result in results:
        if not result.hit or result.wrong:
            print(
                f"{result.subject.name}, seed {result.seed}: found {result.found}", file=sys.stderr
            )
    text, good = report(results)
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
