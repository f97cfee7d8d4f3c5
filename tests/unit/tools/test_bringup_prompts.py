"""The session of the bring-up commands: errors name the port, and bad values are reported."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from bridge.errors import (
    BridgeError,
    CommandRejectedError,
    DeviceLostError,
    StoppedForSafetyError,
)
from bridge.motion.robot_model import RobotModel
from tools.bringup.session import bringup_session

PORT = "/dev/robot"


class FakeSession(nullcontext[None]):
    """A session without a device."""

    def __init__(self, *_: object, **__: object) -> None:
        super().__init__(None)

    def interrupt(self) -> None:
        """Do nothing."""


@pytest.fixture(name="asked")
def _asked(monkeypatch: pytest.MonkeyPatch) -> Any:  # noqa: ANN401 - in place of a port's options
    monkeypatch.setattr("bridge.bringup.session.BringupSession", FakeSession)
    port = SimpleNamespace(name=PORT, close=lambda: None)
    return SimpleNamespace(name=PORT, key=None, node=None, open=lambda: port)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (DeviceLostError("no status from the device"), f"{PORT}: no status from the device"),
        (StoppedForSafetyError("the link was lost"), f"{PORT}: the link was lost"),
        (
            CommandRejectedError("mode", "stop latched"),
            f"{PORT}: the device rejected mode: stop latched",
        ),
        (DeviceLostError(f"{PORT} is gone"), f"{PORT} is gone"),
        (BridgeError("no distance was measured"), "no distance was measured"),
    ],
)
def test_a_failure_names_the_port_once(asked: Any, error: BridgeError, text: str) -> None:  # noqa: ANN401 - as above
    with pytest.raises(type(error)) as caught, bringup_session(asked, None, RobotModel(), ""):
        raise error
    assert str(caught.value) == text


def test_unsuitable_values_are_reported_first(
    asked: Any,  # noqa: ANN401 - as above
    capsys: pytest.CaptureFixture[str],
) -> None:
    wide = dataclasses.replace(RobotModel(), mouth_offset_m=0.15)
    with bringup_session(asked, None, wide, ""):
        pass
    assert "warning: robot: cleaning_width_m, mouth_offset_m: " in capsys.readouterr().err
