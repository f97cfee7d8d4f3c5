"""Entity paths and colours that the converter and the blueprint share."""

from __future__ import annotations

TIMELINE = "run_time"
"""Timeline of the views: time since the first message."""
UNIX_TIMELINE = "unix_time"

WORLD = "world"
ROOM = f"{WORLD}/room"
WALLS = f"{WORLD}/walls"
SWEPT = f"{WORLD}/swept"
CARPETS, THRESHOLDS, CLIFFS = f"{WORLD}/carpets", f"{WORLD}/thresholds", f"{WORLD}/cliffs"
PATH = f"{WORLD}/path"
WHOLE_PATH = f"{WORLD}/whole_path"
TRUTH_PATH = f"{WORLD}/truth_path"
TARGET = f"{WORLD}/target"
ROBOT = f"{WORLD}/robot"
COVARIANCE = f"{WORLD}/covariance"
LANES = f"{WORLD}/lanes"
OCCLUDED = f"{WORLD}/occluded"

VELOCITY, YAW_RATE = "plots/velocity", "plots/yaw_rate"
WHEELS, ACCELERATION = "plots/wheels", "plots/acceleration"
RANGE, BATTERY, CURRENT = "plots/range", "plots/battery", "plots/current"
POSE_ERROR, CLOCK, LINK = "plots/pose_error", "plots/clock", "plots/link"
STATES, EVENTS, PLANNER_TEXT = "states", "events", "planner"

Colour = tuple[int, int, int]
BLUE: Colour = (86, 156, 255)
ORANGE: Colour = (255, 160, 60)
GREEN: Colour = (80, 200, 120)
RED: Colour = (240, 90, 90)
VIOLET: Colour = (190, 130, 255)
FAINT: Colour = (62, 104, 122)
"""Colour of the path older than a minute. It is visible on swept floor, but not brighter than the
floor."""
MAGENTA: Colour = (200, 110, 190)
YELLOW: Colour = (240, 200, 60)
GREY: Colour = (150, 150, 150)
WHITE: Colour = (235, 235, 235)
BACKGROUND: Colour = (20, 22, 26)
