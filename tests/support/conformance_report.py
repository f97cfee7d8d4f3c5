"""The outcome of every check of a device, by chapter of the suite."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest

from bridge.io.ports import is_can
from protocol.messages.values import Capability, flag_labels

if TYPE_CHECKING:
    from protocol.messages.device import Hello as HelloMessage


def kind_of(device: str) -> str:
    """Return the kind of a port or an emulated link: ``uart`` or ``can``."""
    return "can" if is_can(device) or device.endswith("slcan") else "uart"


@dataclass
class Chapter:
    """Outcomes of the checks in one file."""

    passed: int = 0
    failed: int = 0
    not_applicable: int = 0
    not_run: int = 0


@dataclass
class Report:
    """The outcome of every check."""

    chapters: dict[str, Chapter] = field(default_factory=dict)
    checks: list[dict[str, str]] = field(default_factory=list)
    device: dict[str, Any] = field(default_factory=dict)

    def note(self, item: pytest.Item, outcome: str, reason: str = "") -> None:
        title = chapter_of(item)
        chapter = self.chapters.setdefault(title, Chapter())
        setattr(chapter, outcome, getattr(chapter, outcome) + 1)
        check = {"check": item.name, "chapter": title, "outcome": outcome, "reason": reason}
        self.checks.append(check)

    @property
    def passed(self) -> bool:
        return any(c.passed for c in self.chapters.values()) and not any(
            c.failed for c in self.chapters.values()
        )

    def as_json(self, port: str | None) -> str:
        value = {
            "port": port,
            "device": self.device,
            "passed": self.passed,
            "chapters": {title: vars(chapter) for title, chapter in self.chapters.items()},
            "checks": self.checks,
        }
        return json.dumps(value, indent=2) + "\n"


def chapter_of(item: pytest.Item) -> str:
    module = item.getparent(pytest.Module)
    doc: str = (module.obj.__doc__ if module is not None else None) or item.path.stem
    return doc.partition(":")[0].strip().rstrip(".")


def describe_device(hello: HelloMessage, node: int | None, port: str) -> dict[str, Any]:
    return {
        "name": hello.name,
        "version": f"{hello.version_major}.{hello.version_minor}.{hello.version_patch}",
        "node": node,
        "uid": hello.uid.hex(),
        "link": kind_of(port),
        "catalogue": f"{hello.catalogue_hash:08x}",
        "capabilities": flag_labels(Capability, hello.capabilities),
    }
