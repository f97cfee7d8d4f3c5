"""Compile kernels and firmware core; ``pyproject.toml`` has everything else about the package."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from setuptools import Extension, setup

sys.path.insert(0, str(Path(__file__).parent))  # a build frontend does not do it
from tools.dev import kernels

BUILD = Path("build/kernels")
FLAGS = ["/O2", "/fp:precise"] if sys.platform == "win32" else ["-O2", "-ffp-contract=off", "-g0"]
"""Compiler flags: no fast-math, and no CPU-specific code, so equal input gives equal floats
everywhere."""
LOOPS = {
    "language_level": 3,
    "boundscheck": False,
    "cdivision": True,
    "infer_types": True,
    "initializedcheck": False,
    "wraparound": False,
}
"""Cython directives of kernels."""
C_FLAGS = [] if sys.platform == "win32" else ["-std=c99", "-fvisibility=hidden"]
"""Further flags of the firmware core."""
ORDINARY = {"language_level": 3, "annotation_typing": False}
"""Cython directives of modules with types in a .pxd: they behave as in Python."""


def wanted() -> list[Path]:
    """Return the sources to compile: for an in-place build the stale ones, for a wheel all."""
    commands, core = set(sys.argv[1:]), kernels.ROOT / kernels.CORE
    if commands & {"--inplace", "editable_wheel"}:
        return kernels.stale([*kernels.sources(tests="--inplace" in commands), core])
    if commands & {"bdist_wheel", "build", "build_ext", "install"}:
        return [*kernels.sources(), core]
    return []


def stamped(source: Path) -> str:
    """Write a C file with the stamp of a source; its path."""
    path = BUILD / f"{kernels.module_name(source)}.stamp.c"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'const char sweepctl_stamp[] = "{kernels.stamp(source)}";\n', encoding="utf-8")
    return str(path)


def firmware() -> Extension:
    """The firmware's core on a virtual board: a shared library that is an empty module."""
    folder = Path(kernels.FIRMWARE)
    return Extension(
        kernels.module_name(kernels.ROOT / kernels.CORE),
        [
            *(str(source.relative_to(kernels.ROOT)) for source in kernels.core_sources()),
            stamped(kernels.ROOT / kernels.CORE),
        ],
        include_dirs=[str(folder / name) for name in kernels.CORE_FOLDERS],
        extra_compile_args=FLAGS + C_FLAGS,
    )


def extensions(sources: list[Path]) -> list[Extension]:
    """Return one extension for each source, and for a full build the shared one."""
    core = kernels.ROOT / kernels.CORE
    others = [firmware()] if core in sources else []
    sources = [source for source in sources if source != core]
    if not sources:
        return others
    from Cython.Build import cythonize  # noqa: PLC0415 - a list of files needs no compiler

    made = [
        Extension(
            kernels.module_name(source),
            [str(source.relative_to(kernels.ROOT)), stamped(source)],
            extra_compile_args=FLAGS,
        )
        for source in sources
    ]
    shared = kernels.module_name(kernels.ROOT / kernels.SHARED)
    if set(sources) >= set(kernels.sources()):
        made.append(Extension(shared, [], extra_compile_args=FLAGS))
    typed = {kernels.module_name(source) for source in sources if kernels.types(source).exists()}
    compiled: list[Extension] = []
    for directives in (LOOPS, ORDINARY):
        compiled += cythonize(
            [one for one in made if (one.name in typed) == (directives is ORDINARY)],
            build_dir=str(BUILD),
            compiler_directives=directives,
            force=True,
            quiet=True,
            shared_utility_qualified_name=shared,
        )
    return compiled + others


if __name__ == "__main__":  # setuptools' own name for it, too
    setup(
        ext_modules=extensions(wanted()),
        options={"build_ext": {"parallel": os.cpu_count(), "force": True}},
    )
