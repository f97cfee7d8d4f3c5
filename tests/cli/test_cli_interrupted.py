"""After Ctrl-C, a command exits with 0 only if its work is done."""

from __future__ import annotations

import json
import signal
from typing import TYPE_CHECKING, Any, Never, Self

import pytest

from bridge.api.exchange import LoopExchange
from bridge.api.remote import RemoteRobot
from bridge.record.policy import open_log
from bridge.run.client import DeviceClient
from support.emulated import Emulated
from tools.cli.console import print_summary as print_whole
from tools.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

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
    printed = capsys.readouterr().err.strip()
    expected = "interrupted: the stop is not confirmed; check that the robot stands still"
    assert printed == f"sweepctl: {expected}"


def test_a_confirmed_stop_stays_confirmed_after_ctrl_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bridge.io.stopping.stop_device", lambda *_: [1])
    monkeypatch.setattr("tools.commands.stop.inform", interrupt)
    assert run(["stop", str(tmp_path / "port"), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["confirmed"] is True
    assert "not confirmed" not in printed.err


class Robot:
    """A robot that accepts a key; Ctrl-C interrupts the closing of its port."""

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
    assert run(["key", str(tmp_path / "port"), "--set", str(new)]) == 0
    printed = capsys.readouterr().err
    assert f"the key is set; keep {new}" in printed
    assert "interrupted" in printed
    assert new.exists()


def _device() -> dict[str, Any]:
    return {"session": "ready", "run": "waiting", "device": {"boot_id": 1}}


class Asked(Robot):
    """A robot whose port closes at once; Ctrl-C interrupts one of its calls."""

    def __init__(self, cut: str) -> None:
        self._cut = cut

    def __exit__(self, *_: object) -> None:
        """Do nothing."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name == self._cut:
            return interrupt
        return {"snapshot": _device}.get(name, lambda *_, **__: None)


@pytest.mark.parametrize(
    ("arguments", "cut", "known"),
    [
        (("reboot",), "reboot", "the command was not done"),
        (("reboot",), "snapshot", "the command was not done"),
        (("param", "save"), "list_parameters", "the command was not done"),
        (("param", "get", "max_speed"), "get_parameter", "the command was not done"),
    ],
)
def test_a_command_interrupted_by_ctrl_c_does_not_exit_with_0(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    cut: str,
    known: str,
) -> None:
    monkeypatch.setattr("bridge.api.remote.reach", lambda *_, **__: Asked(cut))
    group, *rest = arguments
    names = [] if group == "reboot" else [rest.pop(0)]
    assert run([group, *names, "/nowhere", *rest]) == 1
    assert capsys.readouterr().err.strip() == f"sweepctl: interrupted: {known}"


def test_an_awaited_boot_is_reported_as_under_way(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bridge.api.remote.reach", lambda *_, **__: Asked(""))
    monkeypatch.setattr("bridge.io.clock.pause", interrupt)
    assert run(["reboot", "/nowhere", "--json"]) == 1
    printed = capsys.readouterr()
    assert "the device accepted the command and was not back yet" in printed.err
    assert json.loads(printed.out)["exit_status"] == 1


def test_a_possibly_executed_command_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    class Host:
        """A session whose device does not answer before Ctrl-C."""

    def call(_action: object) -> Never:
        interrupt()

    client = DeviceClient(LoopExchange(Host(), call))  # type: ignore[arg-type]  # not used
    with pytest.raises(KeyboardInterrupt) as caught:
        client.save_parameters()
    printed = ["save parameters: no answer received; the device may have executed it"]
    assert caught.value.__notes__ == printed
    monkeypatch.setattr("bridge.api.remote.ask", interrupt)
    with pytest.raises(KeyboardInterrupt) as caught:
        RemoteRobot("/nowhere").save_parameters()
    assert "save (sent to the owner of the port)" in caught.value.__notes__[0]


def test_a_second_ctrl_c_does_not_cut_off_the_summary(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def print_summary(summary: dict[str, Any], *, as_json: bool) -> None:
        signal.raise_signal(signal.SIGINT)
        print_whole(summary, as_json=as_json)

    monkeypatch.setattr("tools.commands.connect.print_summary", print_summary)
    before = signal.getsignal(signal.SIGINT)
    with Emulated() as emulated:
        out = str(tmp_path / "run.mcap")
        status = run(["connect", emulated.port, "--duration", "0.5", "--json", "--out", out])
    assert status == 0
    assert json.loads(capsys.readouterr().out)["outcome"] == "stopped"
    assert signal.getsignal(signal.SIGINT) == before


def test_ctrl_c_before_a_log_is_open_ends_the_run_as_it_starts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def interrupted_log(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401 - as the original
        signal.raise_signal(signal.SIGINT)
        return open_log(*arguments, **options)

    monkeypatch.setattr("tools.live.run.open_log", interrupted_log)
    out = tmp_path / "run.mcap"
    with Emulated() as emulated:
        status = run(["connect", emulated.port, "--json", "--out", str(out)])
    assert status == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["outcome"], summary["reason"]) == ("stopped", "ended by Ctrl-C")
    assert not out.exists(), "the log of a run without a robot is removed"


@pytest.mark.parametrize("command", ["connect", "simulate"])
def test_ctrl_c_before_a_run_begins_gives_one_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    monkeypatch.setattr("bridge.config.load_robot", interrupt)
    assert run([command, "case-1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "outcome": "stopped",
        "reason": "interrupted before the run began",
        "exit_status": 0,
    }
