"""The Foxglove layout matches a log: each path in the layout leads to an existing field."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as RosFactory

from support.cli import short_runs
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator

LAYOUT = ROOT / "tools" / "layouts" / "sweepctl-foxglove.json"
OWN_PARSERS = {
    "/pose": PoseInFrame,
    "/truth/pose": PoseInFrame,
    "/tf": FrameTransform,
    "/tf_static": FrameTransform,
    "/log": Log,
}


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    made: dict[str, Any] = json.loads(LAYOUT.read_text(encoding="utf-8"))
    return made


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the last message of each topic, decoded with the schemas in the file."""
    log = short_runs(tmp_path_factory)[0].log
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufFactory(), RosFactory()])
        return {
            channel.topic: decoded
            for _, channel, _, decoded in reader.iter_decoded_messages(log_time_order=False)
        }


def panels(node: Any) -> Iterator[str]:  # noqa: ANN401 - any JSON value
    if isinstance(node, str):
        yield node
        return
    assert node["direction"] in {"row", "column"}
    assert 0 < node["splitPercentage"] < 100
    yield from panels(node["first"])
    yield from panels(node["second"])


def paths(config: dict[str, Any]) -> list[str]:
    found = [path["value"] for path in config.get("paths", [])]
    return [*found, config["topicPath"]] if "topicPath" in config else found


def test_every_panel_has_its_place_and_its_settings(layout: dict[str, Any]) -> None:
    placed = list(panels(layout["layout"]))
    assert sorted(placed) == sorted(layout["configById"])
    assert len(set(placed)) == len(placed)
    kinds = {name.split("!")[0] for name in placed}
    assert kinds == {"3D", "Plot", "StateTransitions", "RosOut", "RawMessages"}


def test_every_path_leads_to_a_field(layout: dict[str, Any], messages: dict[str, Any]) -> None:
    count = 0
    for config in layout["configById"].values():
        for path in paths(config):
            topic, *fields = path.split(".")
            assert topic in messages, f"{path}: no such topic in a log"
            value = messages[topic]
            for field in fields:
                match = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field)
                assert match is not None
                value = getattr(value, match[1])
                if match[2] is not None:
                    value = value[int(match[2])]
            assert not fields or isinstance(value, (int, float, str)), path
            count += 1
    assert count > 20


def test_the_room_shows_topics_that_foxglove_draws(
    layout: dict[str, Any], messages: dict[str, Any]
) -> None:
    config = layout["configById"]["3D!room"]
    assert set(config["topics"]) <= set(messages)
    assert config["fixedFrame"] == messages["/pose"].frame_id
    assert messages["/tf"].parent_frame_id == config["fixedFrame"]
    assert layout["configById"]["RosOut!log"]["topicToRender"] in messages


def test_foxgloves_own_parsers_read_the_log(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The test uses Foxglove's compiled schemas, not the schemas in the file."""
    log = short_runs(tmp_path_factory)[0].log
    counts = dict.fromkeys(OWN_PARSERS, 0)
    with log.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(list(OWN_PARSERS)):
            parser: Any = OWN_PARSERS[channel.topic]
            assert schema is not None
            assert schema.name == parser.DESCRIPTOR.full_name
            read = parser.FromString(message.data)
            assert read.timestamp.ToNanoseconds() == message.log_time
            assert len(read.DESCRIPTOR.fields) == len(read.ListFields()) or channel.topic == "/log"
            counts[channel.topic] += 1
    assert min(counts.values()) >= 1
    assert counts["/pose"] > 400
