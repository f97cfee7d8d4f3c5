"""``ports``, ``monitor``, ``stop`` and ``key`` as users run them, without a robot."""

from __future__ import annotations

import json
import stat
from typing import TYPE_CHECKING

import pytest

from bridge.errors import OutputExistsError
from support.cli import sweepctl
from tools.cli.keyfile import KeyFileError, make_key, read_key
from tools.cli.remedies import error_line

if TYPE_CHECKING:
    from pathlib import Path


def test_the_udev_rule_is_printed_unchanged() -> None:
    result = sweepctl("ports", "--udev-rule")
    assert result.status == 0
    assert result.err == ""
    assert result.out.startswith("# A sweeping robot's serial adapter")
    assert 'LABEL="sweepctl_end"' in result.out


def test_the_udev_rule_is_no_json() -> None:
    done = sweepctl("ports", "--udev-rule", "--json")
    assert (done.status, "omit --json" in done.line) == (2, True)


def test_the_traffic_needs_no_robot_file(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text("", encoding="utf-8")
    done = sweepctl("monitor", str(tmp_path / "ttyUSB0"), "--robot", str(robot))
    assert (done.status, "--robot needs --handshake" in done.line) == (2, True)


def test_a_port_that_is_named_is_listed_and_not_opened(tmp_path: Path) -> None:
    result = sweepctl("ports", str(tmp_path / "ttyUSB0"), "--json")
    assert result.status == 0
    (port,) = json.loads(result.out)["ports"]
    assert port["port"] == str(tmp_path / "ttyUSB0")
    assert (port["found"], port["note"]) == (None, None)


def test_stopping_a_port_without_a_device(tmp_path: Path) -> None:
    result = sweepctl("stop", str(tmp_path / "ttyUSB0"))
    assert result.status == 3
    assert "does not exist" in result.err
    assert result.err.count("\n") == 1


def test_a_key_is_set_or_removed_and_not_both(tmp_path: Path) -> None:
    port = str(tmp_path / "ttyUSB0")
    for arguments in ([port], [port, "--clear", "--set", str(tmp_path / "k")]):
        result = sweepctl("key", *arguments)
        assert result.status == 2
        assert "--set FILE or --clear" in result.err
    assert not (tmp_path / "k").exists()


def test_a_robot_that_is_not_there_gets_no_key(tmp_path: Path) -> None:
    result = sweepctl("key", str(tmp_path / "ttyUSB0"), "--set", str(tmp_path / "k"))
    assert result.status == 3
    assert not (tmp_path / "k").exists()


# ---- the file ---------------------------------------------------------------------------


def test_a_key_file_is_its_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "robot.key"
    key = make_key(path)
    assert len(key) == 16
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert read_key(path) == key
    assert read_key(None) is None
    with pytest.raises(OutputExistsError) as exists:
        make_key(path)
    assert error_line(exists.value) == f"{path} exists; give another name"
    path.chmod(0o644)
    with pytest.raises(KeyFileError, match="chmod 600"):
        read_key(path)


@pytest.mark.parametrize("text", ["", "zz" * 16, "00" * 15, "00" * 17, "\x00\xff", "é"])
def test_invalid_keys(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.key"
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match="32 hexadecimal digits"):
        read_key(path)


def test_a_key_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="No such file"):
        read_key(tmp_path / "none")
    result = sweepctl("connect", str(tmp_path / "tty"), "--key-file", str(tmp_path / "none"))
    assert result.status == 2
