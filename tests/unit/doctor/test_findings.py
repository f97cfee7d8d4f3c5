"""The doctor's rules on handmade data, and on some faults of the emulator."""

from __future__ import annotations

import pytest

from bridge.doctor import ADVICE, Examination
from bridge.doctor.wire_view import Damaged
from bridge.session.records import Severity
from campaign.doctor import SUBJECTS, case, uncovered
from protocol.messages.device import Encoders, Hello, LinkCounters, LogText, Power, Status
from protocol.messages.values import Fault, LogLevel, ResetCause, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.doctor_cases import DoctorCase, examine

pytestmark = pytest.mark.slow

MS = 1_000_000


class Line:
    """A device whose messages come from the test, and the doctor that receives them."""

    def __init__(self) -> None:
        self.examination = Examination()
        self.link = Link(Direction.DEVICE)
        self.now_ms = 1000
        self.late_ms = 0

    def inform(self, message: object, *, every_ms: int = 10, count: int = 1) -> None:
        """Send a message ``count`` times; each has the time of its sending as its stamp."""
        for _ in range(count):
            self.now_ms += every_ms
            self.link.send(message, self.now_ms * 1000, node=1)  # type: ignore[arg-type]  # any
            self.hear(self.link.data_to_send())

    def hear(self, data: bytes) -> None:
        self.examination.received(data, (self.now_ms + self.late_ms + 5000) * MS)

    @property
    def kinds(self) -> list[str]:
        return [finding.kind for finding in self.examination.conclude()]


def hello(boot: int = 1, cause: ResetCause = ResetCause.POWER_ON) -> Hello:
    return Hello(CATALOGUE.hash, bytes(12), boot, 5, cause, 0, 1, 2, 3, "hand")


COUNTS = Encoders(7, 7)


def test_a_quiet_good_line_is_well() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=400)
    assert line.kinds == []
    figures = line.examination.figures()
    assert figures["frames"] == 401
    assert figures["lost"] == figures["damaged"] == 0
    assert figures["boots"][0] == {
        "boot_id": "00000001",
        "cause": "power_on",
        "firmware": "hand 1.2.3",
        "uid": "00" * 12,
    }
    assert figures["streams"]["encoders"]["rate_hz"] == pytest.approx(100.0)
    assert figures["drift_ppm"] == pytest.approx(0.0, abs=1e-3)


def frame(line: Line) -> bytes:
    line.now_ms += 10
    line.link.send(COUNTS, line.now_ms * 1000, node=1)
    return line.link.data_to_send()


@pytest.mark.parametrize(
    ("harm", "kind", "what"),
    [
        (lambda f: f[:-3] + bytes([f[-3] ^ 0x44]) + f[-2:], "line_noise", Damaged(whole=5)),
        (lambda f: f[:9] + f[10:], "overrun", Damaged(short=5)),
    ],
)
def test_damage_is_distinguished_by_length(harm: object, kind: str, what: Damaged) -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=50)
    for _ in range(5):
        line.hear(harm(frame(line)))  # type: ignore[operator]  # a function of bytes
        line.inform(COUNTS, count=10)
    assert line.kinds == [kind]
    seen = line.examination.wire.damaged
    assert (seen.whole, seen.short, seen.long) == (what.whole, what.short, what.long)
    assert line.examination.wire.lost == 5


def test_frames_that_come_twice() -> None:
    line = Line()
    line.inform(hello())
    for _ in range(60):
        data = frame(line)
        line.hear(data)
    for _ in range(3):
        line.hear(data)
    assert line.kinds == ["repeated"]


def test_missing_numbers_without_damage_are_an_overrun() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=60)
    for _ in range(4):
        frame(line)
        line.inform(COUNTS, count=20)
    assert line.kinds == ["overrun"]
    assert line.examination.wire.lost == 4


@pytest.mark.parametrize("cut", [0, 3], ids=["between frames", "inside a frame"])
def test_a_piece_that_is_missing_is_a_gap_however_short(cut: int) -> None:
    """The recovered log lacks one chunk, so the gap may begin in the middle of a frame."""
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, every_ms=4, count=400)
    if cut:
        line.link.send(COUNTS, line.now_ms * 1000, node=1)
        line.hear(line.link.data_to_send()[:cut])
    for _ in range(54):
        line.now_ms += 4  # 0.2 s in all, too short for a gap by time alone
        line.link.send(COUNTS, line.now_ms * 1000, node=1)
        line.link.data_to_send()
    line.inform(COUNTS, every_ms=4, count=400)
    (found,) = line.examination.conclude()
    assert (found.kind, found.severity) == ("gap", Severity.WARNING)
    missing = 55 if cut else 54
    assert found.data == {"lost": missing, "frames": 801, "piece": missing, "at_s": 1.6}
    assert f"{missing} of them consecutive at 1.6 s" in found.text


def test_a_hole_and_a_stall() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=200)
    for _ in range(50):
        frame(line)  # frames of half a second are not received
    line.inform(COUNTS, count=200)
    assert line.kinds == ["gap"]
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=200)
    for delay_ms in range(500, 0, -10):  # half a second that arrived at once, late
        line.late_ms = delay_ms - 10
        line.inform(COUNTS)
    line.inform(COUNTS, count=200)
    assert line.kinds == ["host_stall"]


def test_a_clock_that_runs_away_and_one_that_jumps() -> None:
    line = Line()
    line.inform(hello())
    for index in range(1500):
        line.late_ms = index // 150  # a millisecond in 1.5 s
        line.inform(COUNTS)
    assert line.kinds == ["clock_drift"]
    assert line.examination.figures()["drift_ppm"] == pytest.approx(-660, rel=0.1)
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=500)
    line.late_ms = 70
    line.inform(COUNTS, count=500)
    findings = line.examination.conclude()
    assert [f.kind for f in findings] == ["clock_step"]
    assert findings[0].data["jumps"][0][1] == pytest.approx(-70.0, abs=0.5)


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        (ResetCause.PIN, "reset"),
        (ResetCause.SOFTWARE, "reset"),
        (ResetCause.WATCHDOG, "watchdog"),
        (ResetCause.BROWN_OUT, "brown_out"),
        (ResetCause.CRASH, "crash"),
    ],
)
def test_a_boot_and_its_cause(cause: ResetCause, kind: str) -> None:
    line = Line()
    line.inform(hello(1))
    line.inform(COUNTS, count=100)
    line.inform(hello(2, cause))
    line.inform(COUNTS, count=100)
    assert line.kinds == [kind]
    line = Line()
    line.inform(hello(1, cause))
    line.inform(COUNTS, count=100)
    assert line.kinds == ([] if kind == "reset" else [kind]), "of before: a note"


def test_counts_and_reports_of_the_device() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=60)
    line.inform(LinkCounters(65_500, 0, 0, 0, 0, 0, 0, 0))
    line.inform(LinkCounters(100, 3, 40, 0, 0, 0, 0, 0))
    line.inform(Status(0, StopCause.HARDWARE, 0, 0, 95))
    line.inform(Power(16_000, 160, 5, 5))  # 4.0 V on the logic's rail
    assert sorted(line.kinds) == [
        "brown_out",
        "device_receives_noise",
        "late_setpoints",
        "overload",
        "stopped",
    ]


@pytest.mark.parametrize(
    ("drives", "changes", "kinds"), [(True, 0, ["adc"]), (False, 0, []), (True, 1, [])]
)
def test_a_converter_is_frozen_if_it_repeats_itself_while_the_wheels_turn(
    drives: object, changes: int, kinds: list[str]
) -> None:
    line = Line()
    line.inform(hello())
    for index in range(40):
        for step in range(10):
            line.inform(Encoders(*2 * [(10 * index + step) if drives else 7]), every_ms=20)
        line.inform(Power(16_000 - changes * (index // 2), 200, 5, 5), every_ms=1)
    assert line.kinds == kinds


def test_hellos_before_a_session_are_no_gaps() -> None:
    line = Line()
    line.inform(hello(), every_ms=1000, count=100)
    assert line.kinds == ["waiting"]
    line.inform(COUNTS, count=200)
    assert line.kinds == []


def test_not_a_byte_and_not_a_frame() -> None:
    assert Line().kinds == ["no_data"]
    line = Line()
    line.hear(bytes(range(1, 200)) * 3 + b"\0")
    assert line.kinds == ["wrong_baud"]
    line = Line()
    line.hear(b"login: somebody else is here\n")
    assert line.kinds == ["words"]
    line.examination.port_lost.append("it is gone")
    assert line.kinds == ["words"], "a port server that refuses hangs up: no plug is out"


def test_a_device_that_waits_for_a_host() -> None:
    line = Line()
    line.inform(hello(), every_ms=1000, count=5)
    (finding,) = line.examination.conclude()
    assert (finding.kind, finding.severity) == ("waiting", Severity.INFO)
    assert line.examination.figures()["duration_s"] == 4.0
    line.inform(COUNTS, count=2)
    assert line.kinds == []


def test_every_finding_has_advice() -> None:
    for text in ADVICE.values():
        assert len(text) > 20
        assert not text.endswith(".")
        assert "\n" not in text


def test_every_fault_of_the_emulator_has_its_patient() -> None:
    assert uncovered() == set()


def test_a_healthy_run_with_close_turns_has_no_finding() -> None:
    """At 30.9 s a turn of +1.8 rad/s is followed by one of -0.5; the counts are 25 ms late."""
    (subject,) = [p for p in SUBJECTS if p.name == "no fault, driving"]
    assert case(subject, 1).found == []


@pytest.mark.parametrize("ppm", [-300, -150, 0, 150, 300, 495])
def test_the_error_of_a_drift_covers_it(ppm: int) -> None:
    for seconds in (4.8, 8.0, 20.0):
        faults = (f"clock-drift@0:ppm={ppm}",) if ppm else ()
        examination = examine(DoctorCase("drift", faults, seconds=seconds), 1)
        examination.conclude()
        figures = examination.figures()
        assert figures["drift_ppm"] == pytest.approx(ppm, abs=figures["drift_error_ppm"])


def test_two_seconds_are_too_short_for_a_drift() -> None:
    examination = examine(DoctorCase("short", ("clock-drift@0:ppm=495",), seconds=2.0), 1)
    assert examination.conclude() == []
    assert examination.figures()["drift_error_ppm"] is None


SHARE = (
    *("byte-loss", "adapter at 16 ms", "host held up", "another catalogue"),
    *("well, for five seconds", "clock-drift, five seconds", "clock slow, five seconds"),
)


@pytest.mark.parametrize("subject", [p for p in SUBJECTS if p.name in SHARE], ids=lambda p: p.name)
def test_a_share_of_the_confusion_table(subject: object) -> None:
    """``campaign.doctor`` writes the whole table."""
    result = case(subject, 11)  # type: ignore[arg-type]  # of SUBJECTS
    assert result.hit, result.found
    assert result.wrong == []


def counters(*, dropped: int = 0, errors: int = 0, bus_offs: int = 0) -> LinkCounters:
    return LinkCounters(100, 0, 0, dropped, 2 * dropped & 0xFFFF, errors, 0, bus_offs)


def test_a_crystal_that_failed_is_reported() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=60)
    line.inform(Status(0, StopCause.NONE, int(Fault.CLOCK), 0, 5))
    line.inform(Status(0, StopCause.NONE, 0, 0, 5))
    assert line.kinds == ["oscillator"]


def test_full_queues_of_the_device_are_counted() -> None:
    line = Line()
    line.inform(hello())
    line.inform(counters(dropped=65_534))
    line.inform(COUNTS, count=60)
    line.inform(counters(dropped=3))
    (found,) = line.examination.conclude()
    assert (found.kind, found.data) == ("queue_full", {"received": 5, "sent": 10})


@pytest.mark.parametrize(
    ("errors", "bus_offs", "kinds"), [(127, 0, []), (128, 0, ["can_errors"]), (0, 1, ["bus_off"])]
)
def test_can_errors_of_the_device_are_reported(
    errors: int, bus_offs: int, kinds: list[str]
) -> None:
    line = Line()
    line.inform(hello())
    line.inform(counters())
    line.inform(COUNTS, count=60)
    line.inform(counters(errors=errors, bus_offs=bus_offs))
    assert line.kinds == kinds


def test_a_crash_is_reported_with_its_record() -> None:
    line = Line()
    line.inform(hello())
    line.inform(COUNTS, count=60)
    line.inform(hello(2, ResetCause.CRASH))
    line.inform(LogText(LogLevel.ERROR, "crash after 8000 ms: pc 0x08001234"))
    line.inform(COUNTS, count=60)
    (found,) = line.examination.conclude()
    assert found.kind == "crash"
    assert "pc 0x08001234" in found.text
