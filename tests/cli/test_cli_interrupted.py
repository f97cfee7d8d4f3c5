"""Ctrl-C in commands whose status 0 a script takes for done."""

from __future__ import annotations

from typing import TYPE_CHECKING, Never, Self

from tools.cli.main import run

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from bridge.io.reopening import Opener


def interrupt(*_: object, **__: object) -> Never:
    raise KeyboardInterrupt


def test_a_stop_that_ctrl_c_cuts_off_is_not_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop_device(port: str, opened: Opener, node: int | None) -> int:
        interrupt(port, opened, node)

    monkeypatch.setattr("bridge.io.stopping.stop_device", stop_device)
    assert run(["stop", str(tmp_path / "port")]) == 3
    said = capsys.readouterr().err.strip()
    assert said == "sweepctl: interrupted: no stop is confirmed; see that the robot stands"


class Robot:
    """One that takes a key, and whose port is slow to close."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        interrupt()

    def set_key(self, key: bytes | None) -> None:
        assert key is not None


def test_a_key_that_is_set_is_reported_before_the_port_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bridge.open", lambda *_, **__: Robot())
    new = tmp_path / "robot.key"
    run(["key", str(tmp_path / "port"), "--set", str(new)])
    said = capsys.readouterr().err
    assert f"the key is set; keep {new}" in said
    assert "interrupted" in said
    assert new.exists()
