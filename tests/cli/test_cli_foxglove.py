"""The option ``--foxglove`` of ``simulate``, ``replay`` and ``connect``."""

from __future__ import annotations

import re
import signal
from collections import Counter
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from support.cli import short_runs, sweepctl
from support.foxglove_client import FoxgloveClient, Received
from support.two_processes import Command, Emulator

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


def address_of(command: Command) -> str:
    """Wait for the line with the server's address, and return the address."""
    command.prints("Foxglove: ")
    found = re.search(r"Foxglove: (ws://[\d.:]+)", command.printed)
    assert found is not None, command.printed
    return found[1]


def check_received(client: FoxgloveClient, log: Path) -> None:
    """Check that each received message is in the log, and that its schema decodes it equally."""
    written: dict[Received, str] = {}
    for message in LogReader(log).messages():
        key = Received(message.topic, message.log_ns, message.data)
        written[key] = message.topic
    assert set(client.messages) <= set(written)
    topics = Counter(message.topic for message in client.messages)
    for topic in ("/pose", "/device/imu", "/ros/imu", "/tf", "/raw/uart/rx"):
        assert topics[topic] > 20, topics
        message = next(each for each in LogReader(log).messages([topic]))
        assert str(client.decoder(topic)(message.data)) == str(message.decoded)


def test_a_simulated_run_is_served_while_it_happens(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    words = ("simulate", "empty", "--max-time", "12", "--speed", "4", "--out", log)
    with (
        Command(*words, "--foxglove", "0", "--json", cwd=tmp_path) as run,
        FoxgloveClient(address_of(run)) as client,
    ):
        client.send(op="getParameters", parameterNames=["run.planner"], id="1")
        client.receive(lambda c: c.closed)
        done = run.end()
    assert done.status == 1
    assert done.json["outcome"] == "timeout"
    check_received(client, log)
    (answer,) = client.op("parameterValues")
    assert [(each["name"], each["value"]) for each in answer["parameters"]] == [
        ("run.planner", "recovery")
    ]


def test_a_live_run_is_served_and_reads_the_parameters_of_the_device(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path) as device:
        words = ("connect", device.port, "--plan", "paper", "--out", log, "--foxglove", "0")
        with (
            Command(*words, cwd=tmp_path) as host,
            FoxgloveClient(address_of(host)) as client,
        ):
            client.receive(lambda c: Counter(m.topic for m in c.messages)["/pose"] > 100)
            client.send(op="getParameters", parameterNames=["device.wheel_base"], id="1")
            client.receive(lambda c: bool(c.op("parameterValues")))
            host.send(signal.SIGTERM)
            client.receive(lambda c: c.closed)
            assert host.end().status == 0
    check_received(client, log)
    (answer,) = client.op("parameterValues")
    assert [round(each["value"], 3) for each in answer["parameters"]] == [0.23]


def test_a_recorded_run_is_served_until_ctrl_c(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = short_runs(tmp_path_factory)[0].log
    with (
        Command("replay", log, "--speed", "5", "--foxglove", "0", cwd=tmp_path) as player,
        FoxgloveClient(address_of(player)) as client,
    ):
        last_ns = max(message.log_ns for message in LogReader(log).messages())
        client.receive(lambda c: bool(c.times_ns) and c.times_ns[-1] >= last_ns)
        player.prints("the end of the log is reached")
        player.send(signal.SIGINT)
        assert player.end().status == 0
    check_received(client, log)


@pytest.mark.parametrize("text", ["abc", "host:", ":8765", "1:2:3:x", "127.0.0.1:99999"])
def test_a_wrong_address_is_wrong_usage(tmp_path: Path, text: str) -> None:
    done = sweepctl("simulate", "empty", "--out", tmp_path / "a.mcap", "--foxglove", text)
    assert done.status == 2
    assert "--foxglove" in done.line
    assert not (tmp_path / "a.mcap").exists()


def test_an_address_of_another_machine_is_one_line_and_no_log(tmp_path: Path) -> None:
    done = sweepctl(
        "simulate", "empty", "--out", tmp_path / "a.mcap", "--foxglove", "192.0.2.1:8765"
    )
    assert done.status == 1
    assert "cannot serve Foxglove on 192.0.2.1:8765" in done.line
    assert not (tmp_path / "a.mcap").exists()


def test_an_address_for_other_machines_is_warned_of(tmp_path: Path) -> None:
    words = ("simulate", "empty", "--max-time", "3", "--out", tmp_path / "a.mcap")
    warning = "every machine that reaches this port over the network can read the robot's data"
    assert warning in sweepctl(*words, "--foxglove", "0.0.0.0:0").err
    assert warning not in sweepctl(*words, "--force", "--foxglove", "0").err


def test_rerun_and_foxglove_at_once_are_wrong_usage_of_replay(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    log = short_runs(tmp_path_factory)[0].log
    done = sweepctl("replay", log, "--serve", "--foxglove", "0")
    assert (done.status, "not both" in done.line) == (2, True)
    done = sweepctl("replay", log, "--from", "999", "--foxglove", "0")
    assert (done.status, "--from 999 is after the end: the log has" in done.line) == (2, True)
    done = sweepctl("replay", log, "--link", "pty", "--foxglove", "0")
    assert (done.status, "omit" in done.line) == (2, True)
