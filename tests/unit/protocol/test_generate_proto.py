"""The generated protobuf file: protoc reads the same descriptors from it as logs contain."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from google.protobuf import descriptor_pool, json_format, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

from bridge.record.encode.schemas import device_encoders
from bridge.session.records import DeviceMessage
from protocol.generate import render
from protocol.messages.device import Imu, Range
from protocol.schema.catalogue import CATALOGUE, Catalogue
from support.peers import catalogue, longer

if TYPE_CHECKING:
    from pathlib import Path

PROTOC = (sys.executable, "-m", "grpc_tools.protoc")


def compiled(folder: Path, messages: Catalogue = CATALOGUE) -> FileDescriptorProto:
    """Return the descriptor that protoc makes from the generated file."""
    for name, text in render("proto", messages).items():
        (folder / name).write_text(text, encoding="utf-8")
    out = folder / "descriptors.bin"
    done = subprocess.run(
        [*PROTOC, f"-I{folder}", f"--descriptor_set_out={out}", "sweepctl.proto"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    (file,) = FileDescriptorSet.FromString(out.read_bytes()).file
    return file


def bare(file: FileDescriptorProto) -> dict[str, list[tuple[str, int, int, int]]]:
    return {
        m.name: sorted((f.name, f.number, f.type, f.label) for f in m.field)
        for m in file.message_type
    }


@pytest.mark.parametrize(
    "messages", [CATALOGUE, catalogue(less=[Range], more=[longer(Imu)])], ids=["ours", "another"]
)
def test_protoc_reads_the_descriptors_that_logs_are_written_with(
    tmp_path: Path, messages: Catalogue
) -> None:
    file = compiled(tmp_path, messages)
    logged: dict[str, list[tuple[str, int, int, int]]] = {}
    for encoder in device_encoders(messages).values():
        (one,) = FileDescriptorSet.FromString(encoder.layout.descriptor_set()).file
        assert one.package == file.package
        # a descriptor without a syntax means proto2
        assert one.syntax == "proto2"
        assert file.syntax in {"", "proto2"}
        logged.update(bare(one))
    assert bare(file) == logged
    assert len(logged) == len(messages.specs)


def test_a_logged_message_reads_back_by_the_compiled_text(tmp_path: Path) -> None:
    pool = descriptor_pool.DescriptorPool()
    pool.Add(compiled(tmp_path))
    reading = message_factory.GetMessageClass(pool.FindMessageTypeByName("sweepctl.Range"))
    record = DeviceMessage(
        log_ns=0,
        publish_ns=None,
        bound_ns=None,
        node=3,
        seq=0,
        t_us=77,
        name="range",
        message=Range(1234, 255, 40, 2, 61),
    )
    message = reading.FromString(device_encoders()["range"].encode(record))
    values = json_format.MessageToDict(message, preserving_proto_field_name=True)
    assert values == {
        "t_us": 77,
        "node": 3,
        "ultrasonic": 1234,
        "ultrasonic_m": pytest.approx(1.234),
        "infrared_left": 255,  # out of range, so there is no infrared_left_m
        "infrared_right": 40,
        "infrared_right_m": pytest.approx(0.05),
        "contacts": 2,
        "ultrasonic_age": 61,
        "ultrasonic_age_s": pytest.approx(0.061),
    }


def test_each_field_has_its_meaning_as_a_comment() -> None:
    text = render("proto")["sweepctl.proto"]
    assert "// Distance ahead; 65535: no echo (1/1000 m a step)." in text
    assert "// 0 idle, 1 velocity, 2 bringup, 3 onboard." in text
    assert f"catalogue {CATALOGUE.hash:08x}" in text
