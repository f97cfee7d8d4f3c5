"""What is wrong with a link or a log, in words, and what to do about it."""

from __future__ import annotations

from bridge.doctor.examination import Examination
from bridge.doctor.findings import ADVICE, Finding

__all__ = ["ADVICE", "Examination", "Finding"]
