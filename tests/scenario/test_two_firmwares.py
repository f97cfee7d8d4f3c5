"""The C and the Python firmware on equal bytes, readings and times: equal output, byte for byte.

Both implement one specification. A difference is an error in one of them, or a gap in the
specification.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_device.line import line
from sim_device.line.line import LineSettings
from support.random_scripts import FAIR, HOSTILE, SENSED, write
from support.recording_comparison import compare_recorded, lines, record_run, recorded
from support.rigs import OPEN_FLOOR, Drive, rig
from support.scripted_model import compare

pytestmark = pytest.mark.slow

EXAMPLES = settings().max_examples // 2
"""Number of examples, half of the Hypothesis profile's number: 50, or 2500 with the profile deep.
"""


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions(deeds: list[Any]) -> None:
    compare(write(deeds))


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, HOSTILE), max_size=50), begun=st.booleans())
def test_hostile_sessions(deeds: list[Any], *, begun: bool) -> None:
    compare(write(deeds, begun=begun))


@settings(max_examples=EXAMPLES // 2)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions_on_can(deeds: list[Any]) -> None:
    compare(write(deeds, can=True), can=True)


# ---- recorded runs: the inputs of a closed loop, replayed in open loop --------------------------


@pytest.mark.parametrize("can", [False, True], ids=["uart", "can"])
def test_a_recorded_clean(*, can: bool) -> None:
    made = compare_recorded(record_run("case-1", can=can, max_time_s=30.0))
    assert made.exact, "equal inputs give the core's bytes again"
    assert not made.unexplained, "\n".join(lines(made))
    assert not made.unasked, "both read a sensor in the same control periods"
    assert made.frames > 6_000


@pytest.mark.parametrize(
    "faults",
    [
        ("bit-flips@1:4:rate=0.001", "bumper-stuck@5:1:side=left", "ultrasonic-blind@6:1"),
        ("reset@3", "crash@6", "brown-out@9:off=0.2"),
        ("hang@3", "hse-failed@6"),
        ("encoder-reversed@3:side=left",),
        ("wheel-stuck@3:side=right", "lifted@6:1"),
        ("i2c-stuck@3:1", "adc-frozen@5:2", "clock-drift@0:ppm=2000"),
    ],
    ids=lambda faults: faults[0].partition("@")[0],
)
@pytest.mark.parametrize("can", [False, True], ids=["uart", "can"])
def test_a_recorded_run_with_faults(
    faults: tuple[str, ...], *, can: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The model sends all frames at once. The core has few CAN mailboxes, so its frames follow in
    # later calls.
    monkeypatch.setattr(line, "CONTROLLER_FRAMES", line.CAN_QUEUE)
    recording, device = recorded(OPEN_FLOOR, can=can)
    settings = LineSettings(0, 1_000, line.DEFAULT_BITRATE) if can else LineSettings()
    Drive(rig(*faults, settings=settings, device=device), 0.2, 0.3).run(12.0)
    made = compare_recorded(recording)
    assert made.exact
    assert not made.unexplained, "\n".join(lines(made))
    assert not made.unasked


def test_a_firmware_that_differs_is_found() -> None:
    """The model has another wheel diameter: its duties differ, and so do its frames."""
    recording, device = recorded(OPEN_FLOOR)
    Drive(rig(device=device), 0.2).run(4.0)
    other = replace(recording, model=replace(recording.model, wheel_diameter_m=0.07))
    assert "duty" in compare_recorded(other).unexplained
