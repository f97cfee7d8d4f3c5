"""What a run's log calls the parts that are no messages."""

from __future__ import annotations

METADATA = "sweepctl"
"""Name of the metadata record that says what was run."""
DEVICE_METADATA = "device"
"""Of each session's device, as soon as it is known: boot id, uid, firmware."""
ROBOT_ATTACHMENT, ROOM_ATTACHMENT = "robot.toml", "room.json"
CATALOGUE_ATTACHMENT, SUMMARY_ATTACHMENT = "catalogue.json", "summary.json"
