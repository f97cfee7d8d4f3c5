"""The firmware of the virtual devices in a test: the model in Python, or the C core.

A test that uses the fixture ``target`` runs once with each firmware. In such a test the usual
functions (``support.ends.sweeper``, ``support.rigs.rig``, ``run_virtual``) make devices with that
firmware. ``--core-library FILE`` replaces the C core by another library, which runs in the process
of the tests.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from protocol.schema.catalogue import CATALOGUE
from sim_device.core.chip import LocalChip
from sim_device.core.core_sweeper import CoreSweeper
from sim_device.sweeper import VirtualSweeper

if TYPE_CHECKING:
    import pytest

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

TARGETS = ("python", "core")
PYTHON_ONLY = "python_only"
_library: list[Path] = []
"""Library that replaces the built-in core."""


def add_options(parser: pytest.Parser) -> None:
    parser.getgroup("targets").addoption(
        "--core-library", type=Path, metavar="FILE", help="library of the target `core`"
    )


def configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"{PYTHON_ONLY}(reason): changes the firmware's model from inside, so not for the C core",
    )
    library: Path | None = config.getoption("--core-library")
    _library[:] = [] if library is None else [library]


def parametrize(metafunc: pytest.Metafunc) -> None:
    """Run a test with each target; run it only with the Python model if its mark demands this."""
    if "target" in metafunc.fixturenames:
        alone = metafunc.definition.get_closest_marker(PYTHON_ONLY) is not None
        metafunc.parametrize("target", TARGETS[:1] if alone else TARGETS, indirect=True)


def choose(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use this firmware in every device of the test."""
    if target == "core":
        for module in list(sys.modules.values()):
            if getattr(module, "VirtualSweeper", None) is VirtualSweeper and module is not _THIS:
                monkeypatch.setattr(module, "VirtualSweeper", core_sweeper)


_THIS = sys.modules[__name__]


def core_sweeper(
    plan: FloorPlan,
    model: RobotModel | None = None,
    **options: Any,  # noqa: ANN401 - one parameter per option of both devices
) -> CoreSweeper:
    """Make a device with the C core in place of the device with the Python model."""
    assert options.pop("catalogue", CATALOGUE) is CATALOGUE, "the core has the present catalogue"
    if _library:
        options["make_chip"] = partial(LocalChip, library=_library[0])
    return CoreSweeper(plan, model, **options)
