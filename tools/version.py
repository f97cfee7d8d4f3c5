"""Version of the distribution. ``pyproject.toml`` reads it from this module."""

from __future__ import annotations

VERSION = "0.2.0"
