"""Names that an emulator claims: links to its pseudo-terminal, and its control socket."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

import pytest

from sim_device.ports import PortUnavailableError, PtyPort, TcpServerPort
from sim_device.ports.tcp import client_url, is_loopback

if TYPE_CHECKING:
    from pathlib import Path


def test_a_pty_link_has_one_owner_and_ends_with_it(tmp_path: Path) -> None:
    link = tmp_path / "sweeper"
    with PtyPort(link) as first:
        assert first.path == str(link)
        target = link.readlink()
        with pytest.raises(PortUnavailableError, match="another emulator that still runs"):
            PtyPort(link)
        assert link.readlink() == target
        # The same applies to another path to the same folder.
        (tmp_path / "other").symlink_to(tmp_path)
        with pytest.raises(PortUnavailableError, match="another emulator that still runs"):
            PtyPort(tmp_path / "other" / "sweeper")
    assert not os.path.lexists(link)


def test_the_first_to_end_leaves_another_s_link(tmp_path: Path) -> None:
    link = tmp_path / "sweeper"
    first = PtyPort(link)
    link.unlink()  # another process has removed it
    with PtyPort(link):
        target = link.readlink()
        first.close()
        assert link.readlink() == target
    assert not os.path.lexists(link)


def test_a_stale_link_whose_terminal_has_another_owner_by_now(tmp_path: Path) -> None:
    link = tmp_path / "sweeper"
    with PtyPort(tmp_path / "else") as stranger:
        link.symlink_to((tmp_path / "else").readlink())  # the number was assigned again
        with PtyPort(link) as heir:
            assert link.readlink() != (tmp_path / "else").readlink()
            assert heir.path == str(link)
        assert stranger.path == str(tmp_path / "else")
        assert (tmp_path / "else").is_char_device()
    assert list(tmp_path.iterdir()) == []


def test_unplugged_and_back_under_the_same_name(tmp_path: Path) -> None:
    link = tmp_path / "sweeper"
    with PtyPort(link) as port:
        for _ in range(3):
            port.unplug()
            assert port.filenos() == []
            assert not os.path.lexists(link)
            port.plug()
            assert link.is_char_device()
        port.unplug()
        link.write_text("precious")
        with pytest.raises(PortUnavailableError, match="File exists"):
            port.plug()
    assert link.read_text() == "precious"


def test_a_socket_with_a_given_listening_address() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        number = taken.getsockname()[1]
        taken.listen()
        with pytest.raises(PortUnavailableError, match=f"cannot listen on 127.0.0.1:{number}"):
            TcpServerPort("127.0.0.1", number)
    with TcpServerPort("127.0.0.1", number) as port:
        assert port.path == f"socket://127.0.0.1:{number}"
        port.unplug()
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", number))
        port.plug()
        assert port.path == f"socket://127.0.0.1:{number}"
        socket.create_connection(("127.0.0.1", number)).close()
    with pytest.raises(PortUnavailableError, match=r"cannot listen on 203\.0\.113\.9"):
        TcpServerPort("203.0.113.9")


@pytest.mark.parametrize(
    ("host", "url"),
    [
        ("0.0.0.0", "socket://127.0.0.1:5"),  # noqa: S104 - the type is text
        ("::", "socket://127.0.0.1:5"),
        ("", "socket://127.0.0.1:5"),
        ("::1", "socket://[::1]:5"),
        ("192.0.2.7", "socket://192.0.2.7:5"),
    ],
)
def test_a_client_on_this_machine_reaches_a_socket_of_all_addresses(host: str, url: str) -> None:
    assert client_url(host, 5) == url


@pytest.mark.parametrize(
    ("host", "only_here"),
    [
        ("127.0.0.1", True),
        ("127.8.8.8", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),  # noqa: S104 - the type is text
        ("192.168.1.2", False),
        ("robot", False),
    ],
)
def test_which_addresses_can_reach_it(host: str, only_here: bool) -> None:  # noqa: FBT001 - a column
    assert is_loopback(host) == only_here
