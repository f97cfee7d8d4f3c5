"""Diagnosis of a link, a device or a log. Each finding is plain text with a remedy."""

from __future__ import annotations

from bridge.doctor.examination import Examination
from bridge.doctor.findings import ADVICE, Finding

__all__ = ["ADVICE", "Examination", "Finding"]
