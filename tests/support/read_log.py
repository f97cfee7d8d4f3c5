"""Writes a log and reads all of it with the mcap library and its decoders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as RosFactory

from bridge.record.log_writer import RunWriter
from support.synthetic_run import run_info, summary

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.session.records import Record


def written(path: Path, *records: Record) -> list[tuple[str, Any, Any]]:
    """Return topic, MCAP message and decoded message of all messages, by the library's reader."""
    writer = RunWriter(path, run_info())
    for record in records:
        writer.write(record)
    writer.close(summary())
    return read_all(path)


def read_all(path: Path) -> list[tuple[str, Any, Any]]:
    with path.open("rb") as file:
        reader = make_reader(
            file, validate_crcs=True, decoder_factories=[ProtobufFactory(), RosFactory()]
        )
        return [
            (d.channel.topic, d.message, d.decoded_message)
            for d in reader.iter_decoded_messages()
            if d.channel.topic != "/tf_static"
        ]
