"""The live Foxglove server: clients get every channel, and no client delays the run."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bridge.record.log_writer import RunWriter
from bridge.record.policy import RecordOptions, open_log
from bridge.record.reader import LogReader
from bridge.session.records import DeviceMessage, Record, TruthRecord
from bridge.view.errors import FoxgloveMissingError, FoxgloveServerError
from bridge.view.foxglove.publisher import MAX_QUEUED, FoxglovePublisher
from bridge.view.foxglove.replaying import LogFeed
from protocol.messages.device import ParameterValue
from support.foxglove_client import FoxgloveClient, Received
from support.synthetic_run import EPOCH_NS, run_info, synthetic_run

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bridge.record.chunked_file import ChunkTap

pytestmark = pytest.mark.slow

PARAMETERS = {"robot.mass_kg": 3.5, "run.planner": "u-shape", "robot.name": "test"}


@pytest.fixture(name="server")
def running_server() -> Iterator[FoxglovePublisher]:
    made = FoxglovePublisher("127.0.0.1", 0, PARAMETERS)
    yield made
    made.close()


def record_run(path: Path, server: FoxglovePublisher, *, rotate_s: float | None = None) -> None:
    options = RecordOptions(rotate_s=rotate_s)
    with closing(open_log(path, run_info(), options, tap=server)) as writer:
        for record in synthetic_run():
            writer.write(record)


def in_log(path: Path) -> Counter[Received]:
    return Counter(
        Received(message.topic, message.log_ns, message.data)
        for message in LogReader(path).messages()
    )


def counted(client: FoxgloveClient) -> Counter[Received]:
    return Counter(client.messages)


class InStep:
    """A tap that passes each chunk to a server, and waits until a client has received it.

    Without the wait, a client that is slower than the run would lose messages.
    """

    def __init__(self, server: FoxglovePublisher, client: FoxgloveClient) -> None:
        self._server, self._client = server, client
        self._sent = 0

    def begin(self) -> None:
        self._server.begin()

    def take(self, declarations: bytes, chunk: bytes, messages: int) -> None:
        self._server.take(declarations, chunk, messages)
        self._sent += messages
        self._client.receive(lambda c: c.newer(LATER_NS) >= self._sent)


LATER_NS = EPOCH_NS + 1_000_000_000_000
"""Start of a second run, which is recorded after the first run."""


def record_later_run(path: Path, tap: ChunkTap | None) -> None:
    info = replace(run_info(), begun_unix_ns=LATER_NS)
    with closing(RunWriter(path, info, tap=tap)) as writer:
        for record in synthetic_run():
            writer.write(record._replace(log_ns=record.log_ns - EPOCH_NS + LATER_NS))


def subscribe_to_all(client: FoxgloveClient, server: FoxglovePublisher, folder: Path) -> None:
    """Publish a run, so that the client subscribes to each channel."""
    record_run(folder / "before.mcap", server)
    last_ns = max(message.log_ns for message in LogReader(folder / "before.mcap").messages())
    client.receive(lambda c: bool(c.times_ns) and c.times_ns[-1] >= last_ns)
    client.send(op="getParameters", parameterNames=["none"], id="subscribed")
    client.receive(lambda c: bool(c.op("parameterValues")))


def later(client: FoxgloveClient) -> Counter[Received]:
    return Counter(message for message in client.messages if message.log_ns >= LATER_NS)


def test_a_client_gets_every_message_of_the_log_and_its_schemas_decode_them(
    tmp_path: Path, server: FoxglovePublisher
) -> None:
    path = tmp_path / "run.mcap"
    with FoxgloveClient(server.address) as client:
        subscribe_to_all(client, server, tmp_path)
        record_later_run(path, InStep(server, client))
    assert client.protocol == "foxglove.sdk.v1"
    assert server.dropped == 0
    assert later(client) == in_log(path)
    channels = {each["topic"]: each for each in client.channels.values()}
    decoders = {topic: client.decoder(topic) for topic in channels}
    received = {(m.topic, m.log_ns, m.data) for m in client.messages}
    seen = Counter[str]()
    for message in LogReader(path).messages():
        channel = channels[message.topic]
        assert channel["encoding"] == message.channel.message_encoding
        assert channel["schemaName"] == message.channel.schema_name
        seen[message.topic] += 1
        if seen[message.topic] <= 5:  # decoding is slow
            assert (message.topic, message.log_ns, message.data) in received
            assert str(decoders[message.topic](message.data)) == str(message.decoded)
    assert set(seen) == set(channels)
    assert len(seen) > 20


def test_a_late_client_gets_the_present_state(tmp_path: Path, server: FoxglovePublisher) -> None:
    record_run(tmp_path / "run.mcap", server)
    with FoxgloveClient(server.address) as client:
        wanted = {"/map/room": 1, "/tf_static": 3, "/map/coverage": 1, "/planner": 1}
        client.receive(lambda c: Counter(m.topic for m in c.messages) == wanted)


def test_the_channels_stay_the_same_in_every_part_of_a_log(
    tmp_path: Path, server: FoxglovePublisher
) -> None:
    path = tmp_path / "run.mcap"
    with FoxgloveClient(server.address) as client:
        record_run(path, server, rotate_s=2.0)
        last_ns = max(message.log_ns for message in LogReader(path).messages())
        client.receive(lambda c: bool(c.times_ns) and c.times_ns[-1] >= last_ns)
    assert len(LogReader(path).parts) > 2
    topics = [channel["topic"] for channel in client.channels.values()]
    assert len(topics) == len(set(topics))
    assert set(counted(client)) <= set(in_log(path))


def test_parameters_are_shown_and_cannot_be_set(server: FoxglovePublisher) -> None:
    with FoxgloveClient(server.address) as client:
        client.send(op="getParameters", parameterNames=[], id="all")
        client.receive(lambda c: len(c.op("parameterValues")) == 1)
        client.send(
            op="setParameters", parameters=[{"name": "robot.mass_kg", "value": 99}], id="set"
        )
        client.receive(lambda c: bool(c.op("status")) and len(c.op("parameterValues")) == 2)
        client.send(op="getParameters", parameterNames=["robot.mass_kg"], id="again")
        client.receive(lambda c: len(c.op("parameterValues")) == 3)
    values = [
        {each["name"]: each["value"] for each in answer["parameters"]}
        for answer in client.op("parameterValues")
    ]
    assert values == [PARAMETERS, {"robot.mass_kg": 3.5}, {"robot.mass_kg": 3.5}]
    assert "read-only" in client.op("status")[0]["message"]


def test_a_parameter_of_the_device_is_shown(tmp_path: Path, server: FoxglovePublisher) -> None:
    raw = (7, 40, 2, 0, 0x3E800000, 0, 0, 0, "wheel_base m")
    record = DeviceMessage(EPOCH_NS, None, None, 1, 0, 0, "parameter_value", ParameterValue(*raw))
    with closing(RunWriter(tmp_path / "run.mcap", run_info(), tap=server)) as writer:
        writer.write(record)
    with FoxgloveClient(server.address) as client:
        client.receive(lambda c: bool(c.channels))
        client.send(op="getParameters", parameterNames=["device.wheel_base"], id="one")
        client.receive(lambda c: bool(c.op("parameterValues")))
    (answer,) = client.op("parameterValues")
    assert [(each["name"], each["value"]) for each in answer["parameters"]] == [
        ("device.wheel_base", 0.25)
    ]


def test_messages_and_services_of_a_client_are_rejected(server: FoxglovePublisher) -> None:
    with FoxgloveClient(server.address) as client:
        client.receive(lambda c: bool(c.op("serverInfo")))
        (info,) = client.op("serverInfo")
        assert "clientPublish" not in info["capabilities"]
        assert "services" not in info["capabilities"]
        channel = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": "Twist"}
        client.send(op="advertise", channels=[channel])
        client.receive(lambda c: bool(c.op("status")))
    assert "not support clientPublish" in client.op("status")[0]["message"]


def truths(count: int) -> Iterator[Record]:
    """Yield records that are 0.26 s apart, so that each record closes a chunk."""
    pose = next(r.pose for r in synthetic_run() if isinstance(r, TruthRecord))
    for number in range(count):
        yield TruthRecord(EPOCH_NS + 260_000_000 * number, pose)


def test_a_frozen_server_loses_chunks_and_holds_up_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    server = FoxglovePublisher("127.0.0.1", 0, {})
    os.kill(server.pid, signal.SIGSTOP)
    try:
        with closing(RunWriter(path, run_info(), tap=server)) as writer:
            # The pipe to the server holds only a few hundred small chunks.
            for record in truths(3000):
                writer.write(record)
        assert server.dropped > 3000 - MAX_QUEUED - 1500
        assert sum(1 for _ in LogReader(path).messages(["/truth/pose"])) == 3000
    finally:
        server.close()
    assert server.dropped > 3000 - 1500


def test_after_a_freeze_clients_hear_how_many_messages_are_lost(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with (
        closing(FoxglovePublisher("127.0.0.1", 0, {})) as server,
        FoxgloveClient(server.address) as client,
    ):
        client.receive(lambda c: bool(c.op("serverInfo")))
        os.kill(server.pid, signal.SIGSTOP)
        with closing(RunWriter(path, run_info(), tap=server)) as writer:
            for record in truths(3000):
                writer.write(record)
        os.kill(server.pid, signal.SIGCONT)
        expected = f"{server.dropped} messages were dropped"
        client.receive(lambda c: any(expected in s["message"] for s in c.op("status")))
    assert server.dropped > 0


def test_a_client_that_does_not_read_takes_nothing_from_another(
    tmp_path: Path, server: FoxglovePublisher
) -> None:
    path = tmp_path / "run.mcap"
    with FoxgloveClient(server.address) as frozen, FoxgloveClient(server.address) as reading:
        record_run(tmp_path / "before.mcap", server)
        frozen.receive(lambda c: len(c.channels) > 10)  # from now on, it reads nothing
        reading.receive(lambda c: len(c.channels) > 10 and bool(c.messages))
        record_run(path, server)
        last_ns = max(message.log_ns for message in LogReader(path).messages())
        before = len(reading.messages)
        reading.receive(lambda c: c.times_ns.count(last_ns) >= 2)
        assert len(reading.messages) > before
    assert server.dropped == 0


def test_a_server_that_is_killed_ends_nothing_else(
    tmp_path: Path, server: FoxglovePublisher
) -> None:
    os.kill(server.pid, signal.SIGKILL)
    path = tmp_path / "run.mcap"
    record_run(path, server)
    assert not LogReader(path).truncated
    server.close()


def test_an_address_that_cannot_be_used_is_one_line(server: FoxglovePublisher) -> None:
    with pytest.raises(FoxgloveServerError, match=r"cannot serve Foxglove on 127.0.0.1:\d+: .*use"):
        FoxglovePublisher("127.0.0.1", server.port, {})


def test_without_the_sdk_the_error_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(FoxgloveMissingError, match=r"pip install 'sweepctl\[foxglove\]'"):
        FoxglovePublisher("127.0.0.1", 0, {})


def test_a_recorded_log_is_fed_as_it_was_written(tmp_path: Path, server: FoxglovePublisher) -> None:
    with FoxgloveClient(server.address) as client:
        subscribe_to_all(client, server, tmp_path)
        path = tmp_path / "run.mcap"
        record_later_run(path, None)
        feed = LogFeed(InStep(server, client))
        messages = list(LogReader(path).messages())
        for begin in range(0, len(messages), 500):
            feed.take(messages[begin : begin + 500])
    assert later(client) == in_log(path)
