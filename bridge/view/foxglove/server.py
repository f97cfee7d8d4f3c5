"""Live server for Foxglove: ``python -m bridge.view.foxglove.server HOST PORT``.

It reads the frames of :mod:`bridge.view.foxglove.frames` from its standard input and publishes the
log's messages unchanged. Each topic is a channel with the encoding and the schema of the log. The
server ends at the end of its input. Clients can only read; all their messages are rejected.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from typing import TYPE_CHECKING

import foxglove
from foxglove import Channel, Context, Parameter, Schema, StatusLevel
from foxglove.websocket import Capability, ServerListener

from bridge.io import clock
from bridge.record.reader import ChunkReader
from bridge.record.unpack import DAMAGE, content_records
from bridge.session.parameters import Parameter as DeviceParameter
from bridge.view.foxglove.frames import FrameKind, read_frames

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import BinaryIO

    from foxglove.websocket import ChannelView, Client, WebSocketServer

    from bridge.record.reader import LogChannel, LogMessage
    from bridge.view.foxglove.frames import PipeFrame

STATE_TOPICS = {"/tf_static": 8, "/map/room": 1, "/map/coverage": 1, "/planner": 1}
"""Map of each topic that describes a state to the number of its newest messages that a new
subscriber receives at once. Messages of these topics are rare."""
_PARAMETER_TOPIC = "/device/parameter_value"
_BACKLOG = 4096
"""Maximum number of messages that the server stores for a slow client. Older messages are lost. One
second of a full link at 3 Mbaud has 10 000 messages."""
_NICE = 5
_FLUSH_S = 0.3
"""Time between the last message and the stop of the server, s. Clients receive the message in this
time."""


class ReadOnly(ServerListener):
    """Listener of the server that reports parameters, resends states and rejects changes."""

    def __init__(self, parameters: dict[str, Parameter], resend: Callable[[str], None]) -> None:
        """Create the listener; ``resend`` is called with the topic of each new subscription."""
        self._parameters = parameters
        self._resend = resend
        self.server: WebSocketServer | None = None

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Resend the state of the topic."""
        del client
        self._resend(channel.topic)

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        """Return the parameters with these names; without names, return all parameters."""
        del client, request_id
        known = self._parameters
        return [known[name] for name in param_names or sorted(known) if name in known]

    def on_set_parameters(
        self, client: Client, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        """Change nothing and return the current values."""
        del client, request_id
        if self.server is not None:
            text = "parameters are read-only here; use `sweepctl param set`"
            self.server.publish_status(text, StatusLevel.Warning, "read-only")
        known = self._parameters
        return [known[each.name] for each in parameters if each.name in known]


class LiveServer:
    """Publishes the chunks of a log."""

    def __init__(self, host: str, port: int) -> None:
        """Listen.

        Raises:
            Exception: an error of the SDK, such as a port in use.

        """
        self._context = Context()
        self._channels: dict[tuple[str, str, str], Channel] = {}
        self._states: dict[str, list[LogMessage]] = {}
        self._parameters: dict[str, Parameter] = {}
        self._lock = threading.Lock()
        self._reader = ChunkReader()
        listener = ReadOnly(self._parameters, self._resend)
        self._server = foxglove.start_server(
            name="sweepctl",
            host=host,
            port=port,
            capabilities=[Capability.Parameters, Capability.Time],
            server_listener=listener,
            context=self._context,
            message_backlog_size=_BACKLOG,
        )
        listener.server = self._server
        self.port = self._server.port
        """TCP port on which the server listens."""

    def take(self, frame: PipeFrame) -> None:
        """Handle one frame."""
        match frame.kind:
            case FrameKind.FILE:
                self._reader = ChunkReader()
            case FrameKind.RECORDS:
                with contextlib.suppress(*DAMAGE):
                    self._records(frame.content)
            case FrameKind.DROPPED:
                text = f"{frame.content.decode()} messages were dropped: this server was too slow"
                self._server.publish_status(text, StatusLevel.Warning, "dropped")
            case FrameKind.PARAMETERS:
                self._set_parameters(json.loads(frame.content))

    def close(self) -> None:
        """Stop the server."""
        clock.pause(_FLUSH_S)
        self._server.stop()

    def _records(self, content: bytes) -> None:
        for opcode, start, end in content_records(content):
            messages = self._reader.messages(opcode, content[start:end])
            with self._lock:
                for message in messages:
                    self._publish(message)
            if messages:
                self._server.broadcast_time(messages[-1].log_ns)

    def _publish(self, message: LogMessage) -> None:
        channel = message.channel
        self._channel(channel).log(message.data, log_time=message.log_ns)
        kept = STATE_TOPICS.get(channel.topic)
        if kept is not None:
            self._states[channel.topic] = [*self._states.get(channel.topic, []), message][-kept:]
        elif channel.topic == _PARAMETER_TOPIC:
            with contextlib.suppress(ValueError):
                parameter = DeviceParameter.from_message(message.decoded)
                self._set_parameters({f"device.{parameter.name}": parameter.value})

    def _channel(self, declared: LogChannel) -> Channel:
        """Return the channel of a topic. It is the same channel in every file of a run."""
        key = declared.topic, declared.message_encoding, declared.schema_name
        channel = self._channels.get(key)
        if channel is None:
            schema = declared.schema
            channel = self._channels[key] = Channel(
                declared.topic,
                schema=None
                if schema is None
                else Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
                message_encoding=declared.message_encoding,
                context=self._context,
            )
        return channel

    def _resend(self, topic: str) -> None:
        """Send the state of a topic again. Other clients receive it twice."""
        with self._lock:
            for message in self._states.get(topic, ()):
                self._channel(message.channel).log(message.data, log_time=message.log_ns)

    def _set_parameters(self, values: dict[str, object]) -> None:
        made = [Parameter(name, value=value) for name, value in values.items()]  # type: ignore[arg-type]  # plain values
        self._parameters.update({each.name: each for each in made})
        self._server.publish_parameter_values(made)


def serve(host: str, port: int, given: BinaryIO) -> int:
    """Serve until the input ends; return the exit status."""
    try:
        server = LiveServer(host, port)
    except Exception as error:  # noqa: BLE001 - the SDK's errors have no common class
        sys.stdout.write(f"failed {str(error).splitlines()[0]}\n")
        return 1
    sys.stdout.write(f"ready {server.port}\n")
    sys.stdout.flush()
    for frame in read_frames(given):
        server.take(frame)
    server.close()
    return 0


def main() -> int:
    """Serve on HOST and PORT of the command line."""
    with contextlib.suppress(AttributeError, OSError):
        os.nice(_NICE)
    return serve(sys.argv[1], int(sys.argv[2]), sys.stdin.buffer)


if __name__ == "__main__":
    sys.exit(main())
