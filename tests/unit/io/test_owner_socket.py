"""The socket of the process that owns a port: its clients, its answers, and its files."""

from __future__ import annotations

import json
import os
import socket
import stat
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from bridge.errors import BridgeError, NoOwnerError, OwnerRejectedError
from bridge.io import owner_names
from bridge.io.owner_client import ask, has_owner, watch
from bridge.io.owner_names import NoFolderError, folder, link_names
from bridge.io.owner_socket import (
    MAX_ANSWERS,
    MAX_CLIENTS,
    MAX_LINE,
    MAX_VIEWERS,
    OwnerSocket,
)

if TYPE_CHECKING:
    from collections.abc import Iterator


PATIENCE_S = 60.0
"""Maximum time of a step, s; only a hang is longer."""


class Waiting:
    """Counts waiting threads."""

    def __init__(self) -> None:
        self._count = threading.Semaphore(0)

    def one_more(self) -> None:
        self._count.release()

    def acquire_all(self, count: int) -> None:
        for _ in range(count):
            assert self._count.acquire(timeout=PATIENCE_S)


class Robot:
    """A robot that answers with the request and the name of the client."""

    def __init__(self) -> None:
        self.over = False
        self.shown = 0
        self.waiting = Waiting()
        self.released = threading.Event()

    def answer(self, request: dict[str, Any], requester: str) -> dict[str, Any]:
        match request.get("do"):
            case "stop":
                return {"confirmed": True}
            case "wait":
                self.waiting.one_more()
                return {"waited": self.released.wait(PATIENCE_S)}
            case "break":
                raise ZeroDivisionError
            case "flood":
                return {"flood": "x" * 1_000_000}
            case _:
                return self._other(request, requester)

    def _other(self, request: dict[str, Any], requester: str) -> dict[str, Any]:
        if request.get("do") == "refuse":
            raise OwnerRejectedError("not now", 5)
        if request.get("do") != "echo":
            raise BridgeError("no such request")
        return {"request": request, "asker": requester}

    def dashboard(self) -> dict[str, Any]:
        raise ZeroDivisionError

    def snapshot(self) -> dict[str, Any]:
        self.shown += 1
        self.over = self.shown == 3
        return {"shown": self.shown}


@pytest.fixture(autouse=True, name="runtime")
def _runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # A socket's path has at most 108 bytes, so pytest's own folder may be too long.
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


def test_a_rejection_keeps_its_reason_and_status(owner: OwnerSocket, port: str) -> None:
    with pytest.raises(OwnerRejectedError, match="not now") as rejected:
        ask(port, {"do": "refuse"})
    assert rejected.value.exit_status == 5
    with pytest.raises(OwnerRejectedError, match="no such request"):
        ask(port, {"do": "dance"})
    assert owner.path.exists()


def test_nothing_is_left_behind(port: str, runtime: Path) -> None:
    with OwnerSocket(port, Robot()):
        assert len(list((runtime / "sweepctl").iterdir())) == 3
    assert list((runtime / "sweepctl").iterdir()) == []
    with pytest.raises(NoOwnerError):
        ask(port, {"do": "echo"})


def test_files_of_a_killed_owner_are_replaced(port: str, runtime: Path) -> None:
    where = folder()
    dead = socket.socket(socket.AF_UNIX)
    dead.bind(str(where / "999999999-0.sock"))  # no process has this process id
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


def test_watching_continues_until_the_run_is_over(owner: OwnerSocket, port: str) -> None:
    assert [status["shown"] for status in watch(port, hz=50.0)] == [1, 2, 3, 4], "the end too"
    with pytest.raises(OwnerRejectedError, match="hz"):
        next(watch(port, hz=0.0))
    assert owner.path.exists()


def test_watching_waits_as_long_as_its_rate_needs(
    owner: OwnerSocket, port: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.io.owner_client.ANSWER_TIMEOUT_S", 0.2)
    assert [status["shown"] for status in watch(port, hz=2.0)] == [1, 2, 3, 4]
    assert owner.path.exists()


def _raw(owner: OwnerSocket) -> socket.socket:
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(10.0)
    client.connect(str(owner.path))
    return client


@pytest.mark.parametrize("line", [b"hello\n", b"[1]\n", b"\xff\xfe\n", b"[" * 2000 + b"\n"])
def test_invalid_requests_are_rejected(owner: OwnerSocket, line: bytes) -> None:
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


@pytest.mark.parametrize("hz", ["1e-300", "0", "-1", "50.1", "NaN", "Infinity", "true", "9" * 3000])
def test_an_unknown_rate_is_rejected_by_name(owner: OwnerSocket, hz: str) -> None:
    with _raw(owner) as client, client.makefile("rb") as answers:
        client.sendall(b'{"do": "watch", "hz": %s}\n' % hz.encode())
        assert json.loads(answers.readline()) == {"ok": False, "error": "hz is not in 0.01 to 50"}


def test_a_defect_of_ours_is_reported_and_ends_nothing(owner: OwnerSocket) -> None:
    with _raw(owner) as client, client.makefile("rb") as answers:
        client.sendall(b'{"do": "break"}\n{"do": "echo"}\n')
        broken = json.loads(answers.readline())
        assert (broken["error"], broken["exit_status"]) == ("internal error: ZeroDivisionError", 1)
        assert json.loads(answers.readline())["ok"] is True


def test_many_requests_on_one_line_are_answered_in_their_order(owner: OwnerSocket) -> None:
    asked = [{"do": "echo", "number": number} for number in range(500)]
    with _raw(owner) as client, client.makefile("rb") as answers:
        sending = threading.Thread(
            target=client.sendall, args=(b"".join(json.dumps(a).encode() + b"\n" for a in asked),)
        )
        sending.start()
        assert [json.loads(answers.readline())["request"] for _ in asked] == asked
        sending.join()


def test_thousands_of_invalid_lines_are_rejected(owner: OwnerSocket) -> None:
    with _raw(owner) as client, client.makefile("rb") as answers:
        for _ in range(10):
            client.sendall(b"\n" * 500)
            assert all(json.loads(answers.readline())["ok"] is False for _ in range(500))
        client.sendall(b'{"do": "echo"}\n')
        assert json.loads(answers.readline())["ok"] is True


# ---- a stop is always accepted --------------------------------------------------------------


def stop(port: str) -> None:
    """Send a stop that must be answered within ``PATIENCE_S``."""
    assert ask(port, {"do": "stop"}, timeout_s=PATIENCE_S) == {"ok": True, "confirmed": True}


def crowd(owner: OwnerSocket, count: int, line: bytes) -> list[socket.socket]:
    """Connect a number of clients, each of which sends this line and nothing more."""
    clients = []
    for _ in range(count):
        client = _raw(owner)
        with suppress(OSError):  # it may have been disconnected by now
            client.sendall(line)
        clients.append(client)
    return clients


@pytest.mark.parametrize("count", [8, 50, 500])
@pytest.mark.parametrize(
    "line",
    [b"", b'{"do": "st', b"x" * (MAX_LINE + 1), b'{"do": "echo"}\n', b'{"do": "watch"}\n'],
    ids=["silent", "half a line", "a huge line", "idle after an answer", "watching"],
)
def test_a_stop_passes_a_crowd(owner: OwnerSocket, port: str, count: int, line: bytes) -> None:
    clients = crowd(owner, count, line)
    try:
        for _ in range(3):
            stop(port)
    finally:
        for client in clients:
            client.close()


def test_a_stop_passes_requests_that_wait_for_the_device(port: str) -> None:
    robot = Robot()
    with OwnerSocket(port, robot) as owner:
        clients = crowd(owner, MAX_ANSWERS, b'{"do": "wait"}\n')
        robot.waiting.acquire_all(MAX_ANSWERS)
        with pytest.raises(OwnerRejectedError, match="requests are in progress"):
            ask(port, {"do": "echo"})
        stop(port)
        clients[0].sendall(b'{"do": "stop"}\n')  # behind a request without an answer so far
        assert json.loads(clients[0].recv(4096)) == {"ok": True, "confirmed": True}
        robot.released.set()
        for client in clients:
            assert json.loads(client.recv(4096))["waited"] is True
            client.close()


def test_eight_clients_that_ask_again_and_again_are_never_too_many(
    owner: OwnerSocket, port: str
) -> None:
    """Each request has its own connection, which is counted out before its answer."""
    rejected: list[str] = []

    def ask_often() -> None:
        try:
            for _ in range(50):
                ask(port, {"do": "echo"})
        except BridgeError as error:
            rejected.append(str(error))

    threads = [threading.Thread(target=ask_often) for _ in range(MAX_ANSWERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert rejected == []
    assert owner.path.exists()


def test_a_viewer_chooses_what_it_watches(owner: OwnerSocket, port: str) -> None:
    assert [state["shown"] for state in watch(port, hz=50.0)] == [1, 2, 3, 4]
    with pytest.raises(OwnerRejectedError, match="internal error: ZeroDivisionError"):
        next(watch(port, of="dashboard"))
    for of in ("everything", None):
        with pytest.raises(OwnerRejectedError, match="of is not one of status, dashboard"):
            next(watch(port, of=of))  # type: ignore[arg-type]  # None on purpose
    assert owner.path.exists()


def test_a_stop_passes_slow_senders(owner: OwnerSocket, port: str) -> None:
    clients = crowd(owner, 100, b'{"do": "echo", "text": "')
    dribbled = 0
    for letter in b"abcdefgh":
        for client in clients:
            with suppress(OSError):
                dribbled += client.send(bytes([letter]))
        stop(port)
    assert dribbled == 800
    clients[0].sendall(b'"}\n')
    assert json.loads(clients[0].recv(4096))["request"]["text"] == "abcdefgh"
    for client in clients:
        client.close()


def test_a_stop_passes_clients_that_do_not_read(owner: OwnerSocket, port: str) -> None:
    clients = crowd(owner, MAX_VIEWERS, b'{"do": "flood"}\n' * 10)
    stop(port)
    stop(port)
    for client in clients:
        client.close()


def test_the_oldest_client_without_a_request_is_closed(owner: OwnerSocket, port: str) -> None:
    with _raw(owner) as asking:
        asking.sendall(b'{"do": "echo"}\n')
        assert json.loads(asking.recv(4096))["ok"] is True
        clients = crowd(owner, MAX_CLIENTS + 2, b"")
        assert "too many clients" in json.loads(clients[0].recv(4096))["error"]
        assert clients[0].recv(1) == b""
        assert has_owner(port)
        asking.sendall(b'{"do": "echo"}\n')
        assert json.loads(asking.recv(4096))["ok"] is True, "who has asked stays"
        clients[-1].sendall(b'{"do": "echo"}\n')
        assert json.loads(clients[-1].recv(4096))["ok"] is True
    for client in clients:
        client.close()


def test_viewers_are_counted_apart(port: str) -> None:
    robot = Robot()
    robot.shown = 10
    with OwnerSocket(port, robot) as owner:
        viewers = crowd(owner, MAX_VIEWERS, b'{"do": "watch", "hz": 0.01}\n')
        for viewer in viewers:
            assert json.loads(viewer.recv(4096))["ok"] is True
        with pytest.raises(OwnerRejectedError, match="viewers are connected"):
            next(watch(port))
        assert ask(port, {"do": "echo"})["ok"] is True
        viewers.pop().close()  # its place is free though its next line is due in 100 s
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                assert next(watch(port))["shown"] > 10
                break
            except OwnerRejectedError:
                assert time.monotonic() < deadline, "a viewer that has left keeps its place"
        for viewer in viewers:
            viewer.close()


def test_a_folder_that_others_may_enter_is_not_used(runtime: Path, port: str) -> None:
    (runtime / "sweepctl").mkdir(mode=0o755)
    with pytest.raises(NoFolderError, match="0700"):
        OwnerSocket(port, Robot())
    assert not has_owner(port)


def test_a_runtime_folder_open_to_others_is_not_used(
    runtime: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime.chmod(0o777)
    monkeypatch.setattr("bridge.io.owner_names.tempfile.gettempdir", lambda: str(tmp_path))
    assert folder() == tmp_path / f"sweepctl-{os.getuid()}"


def test_names_of_ports_that_are_no_files() -> None:
    assert len(link_names("socket://127.0.0.1:7000")) == 1
    assert len(link_names("can:socketcan:can0")) == 1
    assert link_names("can:slcan:/dev/ttyACM0@115200") == link_names("/dev/ttyACM0")
