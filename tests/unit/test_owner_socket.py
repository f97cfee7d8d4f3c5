"""The socket of a port's owner: who may ask, what is answered, and what is left behind."""

from __future__ import annotations

import json
import os
import socket
import stat
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from bridge.errors import BridgeError, NoOwnerError, OwnerRefusedError
from bridge.io import owner_names
from bridge.io.owner_client import ask, has_owner, watch
from bridge.io.owner_names import NoFolderError, folder, link_names
from bridge.io.owner_socket import MAX_CLIENTS, MAX_LINE, OwnerSocket

if TYPE_CHECKING:
    from collections.abc import Iterator


class Robot:
    """Answers what it was asked, and who asked."""

    def __init__(self) -> None:
        self.over = False
        self.shown = 0

    def answer(self, request: dict[str, Any], asker: str) -> dict[str, Any]:
        if request.get("do") == "refuse":
            raise OwnerRefusedError("not now", 5)
        if request.get("do") != "echo":
            raise BridgeError("no such request")
        return {"request": request, "asker": asker}

    def snapshot(self) -> dict[str, Any]:
        self.shown += 1
        self.over = self.shown == 3
        return {"shown": self.shown}


@pytest.fixture(autouse=True, name="runtime")
def _runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # Not pytest's own folder: a socket's path has 108 bytes at most.
    with tempfile.TemporaryDirectory(prefix="run-") as name:
        monkeypatch.setenv("XDG_RUNTIME_DIR", name)
        yield Path(name)


@pytest.fixture(name="port")
def _port(tmp_path: Path) -> str:
    (tmp_path / "ttyX0").touch()
    (tmp_path / "sweeper").symlink_to("ttyX0")
    return str(tmp_path / "sweeper")


@pytest.fixture(name="owner")
def _owner(port: str) -> Iterator[OwnerSocket]:
    with OwnerSocket(port, Robot()) as owner:
        yield owner


def test_it_is_found_by_the_name_given_and_by_the_real_path(
    owner: OwnerSocket, port: str, tmp_path: Path
) -> None:
    for name in (port, str(tmp_path / "ttyX0"), os.path.relpath(port)):
        answer = ask(name, {"do": "echo", "value": 1.5})
        assert answer["request"] == {"do": "echo", "value": 1.5}
        assert str(os.getpid()) in answer["asker"]
    assert not has_owner(str(tmp_path / "ttyX1"))
    assert owner.path.exists()


def test_only_this_user_may_enter(owner: OwnerSocket, runtime: Path) -> None:
    assert stat.S_IMODE(owner.path.lstat().st_mode) == 0o600
    assert stat.S_IMODE((runtime / "sweepctl").stat().st_mode) == 0o700


def test_a_refusal_keeps_its_reason_and_status(owner: OwnerSocket, port: str) -> None:
    with pytest.raises(OwnerRefusedError, match="not now") as refused:
        ask(port, {"do": "refuse"})
    assert refused.value.exit_status == 5
    with pytest.raises(OwnerRefusedError, match="no such request"):
        ask(port, {"do": "dance"})
    assert owner.path.exists()


def test_nothing_is_left_behind(port: str, runtime: Path) -> None:
    with OwnerSocket(port, Robot()):
        assert len(list((runtime / "sweepctl").iterdir())) == 3
    assert list((runtime / "sweepctl").iterdir()) == []
    with pytest.raises(NoOwnerError):
        ask(port, {"do": "echo"})


def test_what_a_killed_owner_left_is_replaced(port: str, runtime: Path) -> None:
    where = folder()
    dead = socket.socket(socket.AF_UNIX)
    dead.bind(str(where / "999999999-0.sock"))  # no process has this number
    dead.close()
    for name in link_names(port):
        owner_names.put_link(where, name, where / "999999999-0.sock")
    assert not has_owner(port)
    with OwnerSocket(port, Robot()):
        assert has_owner(port)
        assert not (where / "999999999-0.sock").exists()
    assert list((runtime / "sweepctl").iterdir()) == []


def test_a_port_that_is_back_under_another_path(
    owner: OwnerSocket, port: str, tmp_path: Path
) -> None:
    (tmp_path / "ttyX7").touch()
    assert not has_owner(str(tmp_path / "ttyX7"))
    owner.also(str(tmp_path / "ttyX7"))
    assert has_owner(str(tmp_path / "ttyX7"))
    assert has_owner(port)


def test_an_owner_that_ends_does_not_take_its_successors_names(port: str) -> None:
    first = OwnerSocket(port, Robot())
    with OwnerSocket(port, Robot()):
        first.close()
        assert has_owner(port)


def test_watching_goes_on_until_the_run_is_over(owner: OwnerSocket, port: str) -> None:
    assert [status["shown"] for status in watch(port, hz=50.0)] == [1, 2, 3, 4], "the end too"
    with pytest.raises(OwnerRefusedError, match="hz"):
        next(watch(port, hz=0.0))
    assert owner.path.exists()


def _raw(owner: OwnerSocket) -> socket.socket:
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(10.0)
    client.connect(str(owner.path))
    return client


@pytest.mark.parametrize("line", [b"hello\n", b"[1]\n", b"\xff\xfe\n", b"[" * 2000 + b"\n"])
def test_what_is_no_request_is_told_so(owner: OwnerSocket, line: bytes) -> None:
    with _raw(owner) as client, client.makefile("rb") as answers:
        client.sendall(line)
        answer = json.loads(answers.readline())
        assert answer["ok"] is False
        client.sendall(b'{"do": "echo"}\n')
        assert json.loads(answers.readline())["ok"] is True, "and the next one is heard"


def test_a_line_without_an_end_is_hung_up_on(owner: OwnerSocket) -> None:
    with _raw(owner) as client:
        client.sendall(b"x" * (MAX_LINE + 1))
        assert client.recv(100) == b""


def test_too_many_at_once_are_told_so(owner: OwnerSocket) -> None:
    clients = [_raw(owner) for _ in range(MAX_CLIENTS)]
    try:
        for client in clients:
            client.sendall(b'{"do": "echo"}\n')
            assert json.loads(client.recv(4096))["ok"] is True
        with _raw(owner) as late:
            assert "connected already" in json.loads(late.recv(4096))["error"]
    finally:
        for client in clients:
            client.close()


def test_a_folder_that_others_may_enter_is_not_used(runtime: Path, port: str) -> None:
    (runtime / "sweepctl").mkdir(mode=0o755)
    with pytest.raises(NoFolderError, match="0700"):
        OwnerSocket(port, Robot())
    assert not has_owner(port)


def test_a_runtime_folder_that_others_may_enter_is_passed_over(
    runtime: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime.chmod(0o777)
    monkeypatch.setattr("bridge.io.owner_names.tempfile.gettempdir", lambda: str(tmp_path))
    assert folder() == tmp_path / f"sweepctl-{os.getuid()}"


def test_names_of_ports_that_are_no_files() -> None:
    assert len(link_names("socket://127.0.0.1:7000")) == 1
    assert len(link_names("can:socketcan:can0")) == 1
    assert link_names("can:slcan:/dev/ttyACM0@115200") == link_names("/dev/ttyACM0")
