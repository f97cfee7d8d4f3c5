"""The registry of programs that tests start and that are not part of Python.

It is the source of the marker ``needs`` (``support.needs``), of ``.ci/packages*.txt`` and of the
table in CONTRIBUTING.md. This command writes the files:

    PYTHONPATH=tests python -m support.tools
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

CI = ROOT / ".ci"
CONTRIBUTING = ROOT / "CONTRIBUTING.md"
PROBE_S = 60.0
"""Time limit of one probe, s: far more than a compiler needs on a busy machine."""

_UNMARKED: ContextVar[frozenset[str]] = ContextVar("_UNMARKED", default=frozenset())


@contextlib.contextmanager
def unmarked(*names: str) -> Iterator[None]:
    """In the block, allow programs of these optional tools without the mark ``needs``."""
    before = _UNMARKED.set(startable() | set(names))
    try:
        yield
    finally:
        _UNMARKED.reset(before)


def startable() -> frozenset[str]:
    """Return the tools with programs that may start without a mark at present."""
    return _UNMARKED.get()


class UnknownToolError(LookupError):
    """A test names a tool that is not in the registry."""


@dataclass(frozen=True)
class Package:
    """A system package, and the reason why the tests need it."""

    debian: str
    reason: str
    ubuntu: str = ""
    """Name on Ubuntu 24.04, if it differs."""

    def name(self, distribution: str) -> str:
        """Return the package's name on a distribution, by the ``ID`` of its os-release."""
        return self.ubuntu if distribution == "ubuntu" and self.ubuntu else self.debian


@dataclass(frozen=True)
class Tool:
    """A program or a capability of the system, by the name that tests pass to ``needs``."""

    name: str
    use: str
    """Use of the tool in the tests."""
    programs: tuple[tuple[str, ...], ...]
    """Programs that the tests start; each may have several names, and the first found is used."""
    packages: tuple[Package, ...]
    probe: Callable[[], bool] = lambda: True
    """Condition in addition to the programs; evaluated once."""

    def present(self) -> bool:
        """Return whether all of it is present."""
        with unmarked(self.name):
            return _present(self)


@functools.cache
def _present(tool: Tool) -> bool:
    return all(any(map(shutil.which, names)) for names in tool.programs) and tool.probe()


# ---- probes ---------------------------------------------------------------------------------


def _clang_has_runtimes() -> bool:
    """Return whether clang can link its sanitizers and fuzzer: Debian packages them separately."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "empty.c")
        source.write_text("int LLVMFuzzerTestOneInput(void) { return 0; }\n", encoding="ascii")
        flags = ("-fsanitize=fuzzer,address,undefined", "-o", f"{folder}/empty")
        return _succeeds("clang", *flags, str(source))


def _arm_has_libc() -> bool:
    """Return whether newlib-nano's specification file exists; if so, gcc prints its path."""
    command = ("arm-none-eabi-gcc", "-print-file-name=nano.specs")
    done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_S, check=False)
    return os.sep in done.stdout


def _has_vulkan() -> bool:
    """Return whether the Vulkan loader exists, and a driver manifest in its search path."""
    try:
        ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return False
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        if named := os.environ.get(variable):
            return any(Path(path).is_file() for path in named.split(os.pathsep))
    folders = ("/usr/share/vulkan/icd.d", "/usr/local/share/vulkan/icd.d", "/etc/vulkan/icd.d")
    return any(any(Path(folder).glob("*.json")) for folder in folders)


def _succeeds(*command: str) -> bool:
    done = subprocess.run(command, capture_output=True, timeout=PROBE_S, check=False)
    return done.returncode == 0


# ---- the registry ---------------------------------------------------------------------------

TOOLS = (
    Tool(
        "gcc",
        "compiles the generated C and the firmware (`zig cc` from the lock also works)",
        (("gcc",),),
        (Package("gcc", "compiles the generated C"),),
    ),
    Tool(
        "g++",
        "includes the generated header in a C++ program",
        (("g++",),),
        (Package("g++", "compiles a C++ program that includes the generated header"),),
    ),
    Tool(
        "clang",
        "compiles the generated C, with sanitizers and with the fuzzer",
        (("clang",),),
        (
            Package("clang", "compiles the generated C, with sanitizers and a fuzzer"),
            Package(
                "libclang-rt-dev", "runtime of clang's sanitizers and fuzzer", "libclang-rt-18-dev"
            ),
        ),
        _clang_has_runtimes,
    ),
    Tool(
        "addr2line",
        "names the lines of a crashed firmware",
        (("addr2line",),),
        (Package("binutils", "names the lines of a crashed firmware"),),
    ),
    Tool(
        "gdb",
        "attaches to a firmware that waits for it",
        (("gdb",),),
        (Package("gdb", "debugs a firmware in the simulator"),),
    ),
    Tool(
        "arm-none-eabi-gcc",
        "builds the firmware for its chips, and measures its size and stack",
        (
            ("arm-none-eabi-gcc",),
            ("arm-none-eabi-size",),
            ("arm-none-eabi-nm",),
            ("arm-none-eabi-objdump",),
        ),
        (
            Package("gcc-arm-none-eabi", "C compiler for the Cortex-M4, with binutils"),
            Package("libnewlib-arm-none-eabi", "C library of the firmware"),
        ),
        _arm_has_libc,
    ),
    Tool(
        "qemu-system-arm",
        "runs the firmware on an emulated chip",
        (("qemu-system-arm",),),
        (Package("qemu-system-arm", "emulates the chip of the firmware"),),
    ),
    Tool(
        "tshark",
        "reads captures with the generated dissector",
        (("tshark",),),
        (Package("tshark", "runs the generated dissector on captures of the tests"),),
    ),
    Tool(
        "chromium",
        "opens the web viewer",
        (("chromium", "chromium-browser", "google-chrome"),),
        (
            Package(
                # Ubuntu's chromium is a snap, which can access neither /tmp nor a debugging pipe.
                "chromium",
                "browser for the web viewer",
                "google-chrome-stable",
            ),
        ),
    ),
    Tool(
        "systemd-analyze",
        "checks the units of `examples/systemd`",
        (("systemd-analyze",),),
        (Package("systemd", "checks the units of the examples"),),
    ),
    Tool(
        "vulkan",
        "draws the viewer's window off screen",
        (),
        (
            Package(
                "mesa-vulkan-drivers",
                "software rendering of the viewer's screenshot, without a GPU",
            ),
            Package("libvulkan1", "loader of that driver"),
        ),
        _has_vulkan,
    ),
)
BY_NAME = {tool.name: tool for tool in TOOLS}
PROGRAMS = {name: tool for tool in TOOLS for names in tool.programs for name in names}
"""Tool of each program."""
BASE = frozenset({"bash", "make", "sh", "uname", "fc-list"})
"""Programs that need no mark: those of every machine that can run `make test` (Dask asks ``uname``
for the processor), and ``fc-list``, which matplotlib starts once for each user if the system has
it."""


def tool_named(name: str) -> Tool:
    """Return the tool.

    Raises:
        UnknownToolError: there is none of this name.

    """
    try:
        return BY_NAME[name]
    except KeyError:
        known = ", ".join(BY_NAME)
        raise UnknownToolError(f"the registry has no tool {name!r}; it has {known}") from None


def distribution() -> str:
    """Return ``ID`` of this system's os-release; empty if there is none."""
    try:
        text = Path("/etc/os-release").read_text(encoding="utf-8")
    except OSError:
        return ""
    found = re.search(r'^ID="?([\w.-]+)"?$', text, re.MULTILINE)
    return found[1] if found else ""


def packages(tools: Iterable[Tool], system: str) -> list[str]:
    """Return the package names of these tools on a distribution, each once."""
    return list(dict.fromkeys(p.name(system) for tool in tools for p in tool.packages))


def install_command(tools: Iterable[Tool], system: str) -> str:
    """Return the shell command that installs these tools, in one line."""
    names = packages(tools, system)
    return shlex.join(["sudo", "apt-get", "install", "--no-install-recommends", *names])


# ---- generated files -------------------------------------------------------------------------


HEADERS = Package("python3-dev", "headers of the system's Python, to compile the kernels")


def packages_text(system: str) -> str:
    """Return the text of ``.ci/packages*.txt`` for one distribution."""
    every = (HEADERS, *(p for tool in TOOLS for p in tool.packages))
    rows = {p.name(system): p.reason for p in every}
    width = max(map(len, rows))
    lines = [
        f"# System packages of the tests on {system.capitalize()}, one a line, with the reason.",
        "# Generated from tests/support/tools.py: PYTHONPATH=tests python -m support.tools",
        *(f"{name:<{width}}  # {reason}" for name, reason in rows.items()),
    ]
    return "\n".join(lines) + "\n"


FILES = {CI / "packages.txt": "debian", CI / "packages-ubuntu.txt": "ubuntu"}
BEGIN, END = "<!-- tools: begin -->\n", "<!-- tools: end -->\n"


def contributing_text(page: str) -> str:
    """Return the page with a new table of tools."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    rows = [
        f"| `{tool.name}` | {tool.use} | {', '.join(f'`{p.debian}`' for p in tool.packages)} |"
        for tool in TOOLS
    ]
    table = "| tool | what tests do with it | Debian packages |\n| --- | --- | --- |"
    return f"{before}{BEGIN}{table}\n" + "\n".join(rows) + f"\n{END}{after}"


def main() -> None:
    """Write the files."""
    for path, system in FILES.items():
        path.write_text(packages_text(system), encoding="utf-8")
    page = CONTRIBUTING.read_text(encoding="utf-8")
    CONTRIBUTING.write_text(contributing_text(page), encoding="utf-8")


if __name__ == "__main__":
    main()
