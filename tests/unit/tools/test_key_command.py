"""``sweepctl key --set`` never deletes a key that the robot may have stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import pytest
from click.testing import CliRunner

import bridge
from bridge.errors import CommandRejectedError, DeviceLostError
from tools.commands.key import command

if TYPE_CHECKING:
    from pathlib import Path


class Robot:
    """A robot that receives a key, and then raises the given error."""

    def __init__(self, error: BaseException | None) -> None:
        self.error = error
        self.key: bytes | None = None

    def set_key(self, key: bytes) -> None:
        self.key = key
        if self.error is not None:
            raise self.error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing."""


@pytest.mark.parametrize(
    ("error", "kept", "printed"),
    [
        (None, True, "the key is set; keep"),
        (CommandRejectedError("set key", "not_local"), False, ""),
        (DeviceLostError("the device did not answer set key"), True, "may have stored the key"),
        (DeviceLostError("no answer with its challenge"), True, "may have stored the key"),
        (KeyboardInterrupt(), True, "may have stored the key"),
    ],
    ids=["accepted", "refused", "no answer", "no challenge", "Ctrl-C"],
)
def test_only_a_key_that_the_robot_rejected_is_deleted(
    error: BaseException | None,
    printed: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    kept: bool,
) -> None:
    robot, path = Robot(error), tmp_path / "robot.key"
    monkeypatch.setattr(bridge, "open", lambda *_args, **_options: robot)
    done = CliRunner().invoke(command, ["/dev/ttyUSB7", "--set", str(path)])
    assert path.exists() is kept
    if kept:
        assert robot.key is not None
        assert path.read_text().strip() == robot.key.hex()
    assert printed in done.stderr
    assert ("may have stored" in done.stderr) is (error is not None and kept)


@pytest.mark.parametrize("port", ["can:slcan:/dev/ttyACM0", "socket://10.0.0.7:5000"])
@pytest.mark.parametrize("clear", [True, False])
def test_a_key_is_not_even_sent_over_a_bus_or_a_network(
    port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, clear: bool
) -> None:
    opened: list[object] = []
    monkeypatch.setattr(bridge, "open", lambda *args, **_options: opened.append(args))
    path = tmp_path / "robot.key"
    what = ["--clear"] if clear else ["--set", str(path)]
    done = CliRunner().invoke(command, [port, *what])
    assert done.exit_code == 2
    assert f"{port} is a bus or a network" in " ".join(done.stderr.split())
    assert not opened
    assert not path.exists()
