"""A client of the Foxglove WebSocket protocol that does not use Foxglove's SDK."""

from __future__ import annotations

import base64
import json
import struct
import time
from collections import Counter
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosedOK
from websockets.sync.client import connect
from websockets.typing import Subprotocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
PATIENCE_S = 30.0
"""Maximum time of a step that usually takes a second, s; only a hang is longer."""
_DATA, _TIME = 1, 2


class Received(NamedTuple):
    """A received message."""

    topic: str
    log_ns: int
    data: bytes


class FoxgloveClient:
    """Client that subscribes to every channel and stores all messages."""

    def __init__(self, address: str) -> None:
        self._open = ExitStack()
        made = connect(
            address,
            subprotocols=[Subprotocol(name) for name in PROTOCOLS],
            max_size=None,
            open_timeout=PATIENCE_S,
            close_timeout=0.2,
        )
        self._socket = self._open.enter_context(made)
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: list[Received] = []
        self._newest: Counter[str] = Counter()
        self.texts: list[dict[str, Any]] = []
        """Control messages of the protocol in order of arrival, without the data messages."""
        self.times_ns: list[int] = []
        self.closed = False

    @property
    def protocol(self) -> str | None:
        return self._socket.subprotocol

    def send(self, **message: object) -> None:
        self._socket.send(json.dumps(message))

    def receive(self, until: Callable[[FoxgloveClient], bool]) -> None:
        """Receive until a condition holds or the server closes."""
        end_s = time.monotonic() + PATIENCE_S
        while not until(self) and not self.closed:
            left_s = end_s - time.monotonic()
            assert left_s > 0, "the client waited in vain"
            try:
                self._take(self._socket.recv(timeout=left_s))
            except ConnectionClosedOK:
                self.closed = True

    def newer(self, than_ns: int) -> int:
        """Number of messages from this log time on. Every call must pass an equal time."""
        taken = self._newest["taken"]
        self._newest["newer"] += sum(m.log_ns >= than_ns for m in self.messages[taken:])
        self._newest["taken"] = len(self.messages)
        return self._newest["newer"]

    def op(self, name: str) -> list[dict[str, Any]]:
        """Control messages with this name."""
        return [text for text in self.texts if text["op"] == name]

    def decoder(self, topic: str) -> Callable[[bytes], Any]:
        """Decoder of a topic, from the schema that the server has advertised."""
        (channel,) = [each for each in self.channels.values() if each["topic"] == topic]
        name, kind = channel["schemaName"], channel["schemaEncoding"]
        if channel["encoding"] == "protobuf":
            assert kind == "protobuf"
            pool = descriptor_pool.DescriptorPool()
            for file in FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
                pool.Add(file)
            return message_factory.GetMessageClass(pool.FindMessageTypeByName(name)).FromString
        assert (channel["encoding"], kind) == ("cdr", "ros2msg")
        schema = Schema(id=1, data=channel["schema"].encode(), encoding=kind, name=name)
        made = DecoderFactory().decoder_for("cdr", schema)
        assert made is not None
        return made

    def close(self) -> None:
        self._open.close()

    def _take(self, received: str | bytes) -> None:
        if isinstance(received, str):
            message = json.loads(received)
            self.texts.append(message)
            if message["op"] == "advertise":
                fresh = {channel["id"]: channel for channel in message["channels"]}
                self.channels |= fresh
                wanted = [{"id": number, "channelId": number} for number in fresh]
                self.send(op="subscribe", subscriptions=wanted)
        elif received[0] == _DATA:
            number, log_ns = struct.unpack_from("<IQ", received, 1)
            topic = self.channels[number]["topic"]
            self.messages.append(Received(topic, log_ns, received[13:]))
        elif received[0] == _TIME:
            self.times_ns.append(struct.unpack_from("<Q", received, 1)[0])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
