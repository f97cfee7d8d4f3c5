"""Make a rosbag2 folder of a log: the ROS messages of its topics `/ros/*` and `/map/*`, unchanged.

    python examples/ros2/to_rosbag2.py clean.mcap clean-bag
    ros2 bag play clean-bag

It needs no ROS: a rosbag2 with the storage `mcap` is an MCAP file with ROS messages only, and a
file `metadata.yaml` beside it.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer

METADATA = """\
rosbag2_bagfile_information:
  version: 5
  storage_identifier: mcap
  duration: {{nanoseconds: {duration_ns}}}
  starting_time: {{nanoseconds_since_epoch: {first_ns}}}
  message_count: {count}
  topics_with_message_count:
{topics}
  compression_format: ""
  compression_mode: ""
  relative_file_paths: [{file}]
  files:
  - path: {file}
    starting_time: {{nanoseconds_since_epoch: {first_ns}}}
    duration: {{nanoseconds: {duration_ns}}}
    message_count: {count}
"""
"""Form of the metadata, version 5, which every ROS from Humble on reads."""
TOPIC = """\
  - topic_metadata: {{name: {name}, type: {type}, serialization_format: cdr, \
offered_qos_profiles: ""}}
    message_count: {count}"""


def convert(log: Path, bag: Path) -> int:
    """Write the bag and return the number of its messages.

    Raises:
        FileExistsError: the folder exists.
        ValueError: the log contains no ROS message.

    """
    bag.mkdir()
    file = f"{bag.name}_0.mcap"
    ids: dict[int, int] = {}
    types: dict[str, str] = {}
    counts = Counter[str]()
    first_ns, last_ns = 0, 0
    with log.open("rb") as source, (bag / file).open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2", library="sweepctl")
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.message_encoding != "cdr" or schema is None:
                continue
            if channel.id not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, "cdr", schema_id)
                types[channel.topic] = schema.name
            writer.add_message(
                ids[channel.id], message.log_time, message.data, message.publish_time
            )
            first_ns = min(first_ns or message.log_time, message.log_time)
            last_ns = max(last_ns, message.log_time)
            counts[channel.topic] += 1
        writer.finish()
    if not counts:
        raise ValueError(f"{log} contains no ROS message")
    topics = [
        TOPIC.format(name=name, type=types[name], count=counts[name]) for name in sorted(counts)
    ]
    metadata = METADATA.format(
        first_ns=first_ns,
        duration_ns=last_ns - first_ns,
        count=counts.total(),
        topics="\n".join(topics),
        file=file,
    )
    (bag / "metadata.yaml").write_text(metadata, encoding="utf-8")
    return counts.total()


if __name__ == "__main__":
    if len(sys.argv) != 3:  # noqa: PLR2004 - the names of two files
        sys.exit(f"usage: {sys.argv[0]} LOG.mcap BAG")
    print(f"wrote {convert(Path(sys.argv[1]), Path(sys.argv[2]))} messages to {sys.argv[2]}")
