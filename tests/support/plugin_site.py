"""Installs packages with plug-ins in a folder for another process."""

from __future__ import annotations

import subprocess
import tomllib
from typing import TYPE_CHECKING

from support.processes import COMMAND, Done, environment
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

EXAMPLE = ROOT / "examples" / "plugin"
PATIENCE_S = 110.0


def install(
    site: Path,
    package: str,
    entries: Mapping[str, Mapping[str, str]],
    sources: Mapping[str, str] | None = None,
    version: str = "1.0",
) -> None:
    """Write a package's metadata, its entry points by kind, and its modules by name."""
    folder = site / f"{package.replace('-', '_')}-{version}.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n"
    )
    lines = []
    for kind, points in entries.items():
        lines += [f"[sweepctl.{kind}]", *(f"{name} = {what}" for name, what in points.items()), ""]
    (folder / "entry_points.txt").write_text("\n".join(lines))
    for module, source in (sources or {}).items():
        (site / f"{module}.py").write_text(source)


def install_example(site: Path) -> None:
    """Install examples/plugin."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = project["entry-points"]
    entries = {group.removeprefix("sweepctl."): points for group, points in groups.items()}
    install(site, project["name"], entries, version=project["version"])
    (site / "sweepctl_example").symlink_to(EXAMPLE / "sweepctl_example")


def sweepctl_with(site: Path, *arguments: str | Path) -> Done:
    """Run ``sweepctl`` with the installed packages on its path, in their parent folder."""
    path = f"{site}:{ROOT}"
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)],
        cwd=site.parent,
        env=environment(PYTHONPATH=path),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    return Done(done.returncode, done.stdout, done.stderr)
