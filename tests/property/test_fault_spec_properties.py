"""A fault written as text is read back equal; an invalid text is rejected in one line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_device.faults.kinds import KINDS, as_dict, parse_fault, parse_fault_now
from sim_device.faults.spec import FaultSpec, FaultSpecError, Number, Value

TIMES = st.floats(0.0, 1e7, allow_nan=False)


@st.composite
def specs(draw: st.DrawFn) -> FaultSpec:
    kind = draw(st.sampled_from(list(KINDS.values())))
    values: dict[str, Value] = {}
    for argument in kind.arguments:
        if isinstance(argument, Number):
            values[argument.name] = draw(st.floats(argument.low, argument.high))
        else:
            values[argument.name] = draw(st.sampled_from(argument.choices))
    for_s = draw(st.none() | TIMES) if kind.lasting else None
    return FaultSpec(kind, draw(TIMES), for_s, values)


def read_or_rejected(text: str, *, timed: bool = True) -> FaultSpec | None:
    """Return the fault, or None if the parser rejects the text in one line that quotes it."""
    rejections: list[FaultSpecError] = []
    try:
        return parse_fault(text) if timed else parse_fault_now(text)
    except FaultSpecError as error:
        rejections.append(error)
    assert [rejection.text for rejection in rejections] == [text]
    assert len(str(rejections[0]).splitlines()) == 1
    return None


@given(specs())
def test_written_bytes_are_read(spec: FaultSpec) -> None:
    assert parse_fault(spec.text) == spec


@given(st.text(max_size=60))
def test_any_text_is_read_or_rejected_in_one_line(text: str) -> None:
    read = read_or_rejected(text, timed=False)
    assert read is None or read.kind in KINDS.values()


@given(specs(), st.integers(0, 200), st.characters())
def test_a_damaged_text_too(spec: FaultSpec, place: int, char: str) -> None:
    text = spec.text
    place %= len(text)
    damaged = text[:place] + char + text[place + 1 :]
    read = read_or_rejected(damaged)
    if read is None:
        return
    for argument in read.kind.arguments:
        value = read.values[argument.name]
        if isinstance(argument, Number):
            assert argument.low <= float(value) <= argument.high
        else:
            assert value in argument.choices


@pytest.mark.parametrize(
    ("text", "at_s", "for_s", "values"),
    [
        ("silence@3", 3.0, None, {"way": "both"}),
        ("silence@3:0.5", 3.0, 0.5, {"way": "both"}),
        ("silence@3:500ms:up", 3.0, 0.5, {"way": "up"}),
        ("silence@3s:way=down", 3.0, None, {"way": "down"}),
        ("silence@3::down", 3.0, None, {"way": "down"}),
        ("silence@3:", 3.0, None, {"way": "both"}),
        (" silence@3:2s ", 3.0, 2.0, {"way": "both"}),
        ("wheel_stuck@1.5:2:right", 1.5, 2.0, {"side": "right"}),
        ("bit-flips@0:rate=1e-5", 0.0, None, {"rate": 1e-5, "way": "both"}),
        ("bit-flips@0:1:0.5,up", 0.0, 1.0, {"rate": 0.5, "way": "up"}),
        ("bit-flips@0:1:way=up, rate=0.5", 0.0, 1.0, {"rate": 0.5, "way": "up"}),
        ("reset@30:cause=watchdog", 30.0, None, {"cause": "watchdog"}),
        ("clock-jump@20:ms=-50", 20.0, None, {"ms": -50.0}),
    ],
)
def test_forms(text: str, at_s: float, for_s: float | None, values: dict[str, Value]) -> None:
    spec = parse_fault(text)
    assert (spec.at_s, spec.for_s, dict(spec.values)) == (at_s, for_s, values)


def test_now_and_from_now() -> None:
    assert parse_fault_now("silence").at_s is None
    assert parse_fault_now("silence:2").for_s == 2.0
    later = parse_fault_now("silence@+2:1")
    assert (later.at_s, later.relative) == (2.0, True)
    assert parse_fault_now(later.text) == later
    assert not parse_fault("silence@+2").relative, "without a current time, + is a plain sign"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there is no kind ''"),
        ("wheel-stucc@1", "did you mean wheel-stuck?"),
        ("xyzzy@1", "the kinds are bit-flips, "),
        ("silence", "no time: write silence@SECONDS"),
        ("silence@", "time '' is not a number of seconds from 0 to 1e+07"),
        ("silence@x", "time 'x' is not a number of seconds"),
        ("silence@-1", "time '-1' is not a number of seconds"),
        ("silence@nan", "time 'nan' is not a number of seconds"),
        ("silence@1e9", "time '1e9' is not"),
        ("silence@1:-2", "duration '-2' is not"),
        ("silence@1:inf", "duration 'inf' is not"),
        ("silence@1:5x", "duration '5x' is not"),
        ("silence@1:2:up:3", "too many colons"),
        ("silence@1:2:sideways", "way 'sideways' is not in up, down, both"),
        ("silence@1:2:way=up,way=up", "way is given twice"),
        ("silence@1:2:up,down", "'down' is too much; it takes way"),
        ("silence@1:2:volume=3", "silence has no 'volume'; it takes way"),
        ("unplug@1:2:hard", "'hard' is too much; it takes no arguments"),
        ("reset@1:2", "reset is instantaneous: it has no duration"),
        ("bit-flips@1:2:rate=2", "rate '2' is not in 0 to 1"),
        ("bit-flips@1:2:rate=nan", "rate 'nan' is not in 0 to 1"),
        ("bit-flips@1:2:rate=", "rate '' is not in 0 to 1"),
        ("imu-biased@1:2:gyro=300", "gyro '300' is not in -250 to 250 °/s"),
    ],
)
def test_rejected(text: str, message: str) -> None:
    with pytest.raises(FaultSpecError) as caught:
        parse_fault(text)
    assert message in str(caught.value)
    assert repr(text) in str(caught.value)


def test_every_kind_is_declared_whole() -> None:
    for kind in KINDS.values():
        assert (kind.turn is None) != (kind.strike is None), kind.name
        assert parse_fault(kind.example).kind is kind
        assert kind.meaning.endswith((".", ".)"))
        names = [argument.name for argument in kind.arguments]
        assert len(set(names)) == len(names)
        for argument in kind.arguments:
            assert argument.parse(str(argument.default)) == argument.default
        assert as_dict(kind)["kind"] == kind.name
