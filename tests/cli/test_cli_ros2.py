"""The page about ROS 2: its topics, and the example that makes a rosbag2."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from typing import TYPE_CHECKING

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from bridge.record.reader import LogReader
from support.cli import short_runs
from support.processes import environment
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

SCRIPT = ROOT / "examples" / "ros2" / "to_rosbag2.py"


def ros_topics(log: Path) -> dict[str, str]:
    return {
        message.topic: message.channel.schema_name
        for message in LogReader(log).messages()
        if message.channel.message_encoding == "cdr"
    }


def test_the_page_lists_the_ros_topics_of_a_log(tmp_path_factory: pytest.TempPathFactory) -> None:
    page = (ROOT / "docs" / "ros2.md").read_text("utf-8")
    table = page.partition("<!-- topics: begin -->")[2].partition("<!-- topics: end -->")[0]
    listed = dict(re.findall(r"^\| `(/\S+)` \| `(\S+)` \|$", table, re.MULTILINE))
    assert listed == ros_topics(short_runs(tmp_path_factory)[0].log)


def test_the_example_makes_a_bag_of_the_ros_messages(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log, bag = short_runs(tmp_path_factory)[0].log, tmp_path / "bag"
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(log), str(bag)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env=environment(),
    )
    written = Counter(
        (message.topic, message.log_ns, message.publish_ns, message.data)
        for message in LogReader(log).messages()
        if message.channel.message_encoding == "cdr"
    )
    assert done.stdout == f"wrote {written.total()} messages to {bag}\n"
    with (bag / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        got = Counter[tuple[str, int, int, bytes]]()
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert hasattr(decoded, "header")
            got[channel.topic, message.log_time, message.publish_time, message.data] += 1
    assert got == written
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text("utf-8"))
    information = metadata["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (5, "mcap")
    assert information["relative_file_paths"] == ["bag_0.mcap"]
    assert information["message_count"] == written.total()
    times_ns = [log_ns for _, log_ns, _, _ in written]
    assert information["starting_time"]["nanoseconds_since_epoch"] == min(times_ns)
    assert information["duration"]["nanoseconds"] == max(times_ns) - min(times_ns)
    assert {
        each["topic_metadata"]["name"]: each["topic_metadata"]["type"]
        for each in information["topics_with_message_count"]
    } == ros_topics(log)


def test_an_existing_folder_is_kept(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = short_runs(tmp_path_factory)[0].log
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(log), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env=environment(),
    )
    assert done.returncode == 1
    assert "FileExistsError" in done.stderr
