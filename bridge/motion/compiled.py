"""Compiled kernels: loops over floats and grids, as machine code that is kept between runs.

``kernel_build`` compiles a kernel once, with numba; what it made is kept as an object file and
later loaded by LLVM alone. Importing numba and letting it load its own cache takes a second,
several times as long as everything else that a short command does.

A kernel takes ints, floats, bools and C-contiguous arrays, and gives nothing, a number or a
tuple of numbers. Of its scalars the annotations say what they are, of its arrays the first call
does; later calls must agree. It cannot allocate, raise, or divide by zero and be told: what it
needs room for is passed in. Callees stand in the same file or are kernels themselves.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import struct
import sys
import tempfile
import types
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, ParamSpec, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

_Args = ParamSpec("_Args")
_Result = TypeVar("_Result")

_SCALARS = {"int": "i", "float": "d", "bool": "b"}
_FORMAT = 3
"""Of the kept files; raised when what ``kernel_build`` makes changes."""

_MAGIC = b"sweepctl"
_SEAL = struct.Struct("<8sQ32s")
"""What stands before kept code: magic, the code's length in bytes, SHA-256 of name and code."""
_FOREIGN_WRITABLE = 0o022
"""Permission bits of a file that others than its owner may write."""

KERNELS: dict[Any, Kernel] = {}
"""By the function that stands for it."""
_engines: list[Any] = []
"""What holds the loaded code."""


class KernelArgumentError(TypeError):
    """A kernel was called with what it was not compiled for."""

    def __init__(self, kernel: str, wanted: tuple[str, ...], got: tuple[str, ...]) -> None:
        """Say both as dtype and dimensions."""
        self.kernel, self.wanted, self.got = kernel, wanted, got
        super().__init__(
            f"kernel {kernel} is compiled for ({', '.join(wanted)}), "
            f"and was called with ({', '.join(got)})"
        )


def compiled(kernel: Callable[_Args, _Result]) -> Callable[_Args, _Result]:
    """Compile a function of numbers and numpy arrays at its first call, and keep the code.

    The code is kept beside the module (or, where that cannot be written, in the user's
    cache), so only the first run ever pays for it; ``make`` pays at installation. Without
    ``fastmath``: equal input gives equal floats.
    """
    return cast("Callable[_Args, _Result]", Kernel(kernel).stub)


def compiled_unlocked(kernel: Callable[_Args, _Result]) -> Callable[_Args, _Result]:
    """Compile as ``compiled`` does; the code runs without the interpreter's lock.

    For what takes long enough that other threads should go on meanwhile. Nobody else may
    write to the arrays until it is done.
    """
    return cast("Callable[_Args, _Result]", Kernel(kernel, unlocked=True).stub)


class Kernel:
    """One kernel: its Python text, and its machine code once it was called."""

    def __init__(self, function: Callable[..., Any], *, unlocked: bool = False) -> None:
        """Nothing is compiled yet."""
        self.function = function
        self.unlocked = unlocked
        """Whether it runs without the interpreter's lock."""
        self.name = f"{function.__module__}.{function.__name__}"
        self.kinds: tuple[str, ...] | None = None
        """What it was compiled for, once it is compiled or loaded."""
        self.was_built = False
        """Whether it had to be compiled, because no kept code was found."""
        self._parameters = list(inspect.signature(function).parameters.values())
        names = ", ".join(parameter.name for parameter in self._parameters)
        self._scope: dict[str, Any] = {"_call": self._first}
        # The function that others import: it stays the same one when the code is there.
        text = f"def {function.__name__}({names}):\n    return _call({names})\n"
        exec(text, self._scope)  # noqa: S102 - our own text
        self.stub = self._scope[function.__name__]
        self.stub.__doc__, self.stub.__module__ = function.__doc__, function.__module__
        KERNELS[self.stub] = self

    def _first(self, *args: object) -> object:
        """Load or compile, and let this and later calls go to the code."""
        self._scope["_call"] = self._ready_for(self._kinds(args))
        call: Callable[..., object] = self._scope["_call"]
        return call(*args)

    def _ready_for(self, kinds: tuple[str, ...]) -> Callable[..., Any]:
        from bridge.motion.kernel_call import layout_is_known, make_function  # noqa: PLC0415

        self.kinds = kinds
        if not layout_is_known():
            from bridge.motion.kernel_build import dispatcher  # noqa: PLC0415 - as below

            self.was_built = True
            numbas: Callable[..., Any] = dispatcher(self)
            return numbas
        name = self._file(kinds)
        paths = [place / name for place in self._places()]
        owners = {0, Path(self.function.__code__.co_filename).stat().st_uid}
        machine = next(filter(None, (kept(path, owners) for path in paths)), None)
        if machine is None:
            from bridge.motion.kernel_build import build  # noqa: PLC0415 - numba takes long

            machine = build(self, kinds)
            self.was_built = True
            # Where nothing can be written the next run compiles again.
            with contextlib.suppress(OSError):
                keep(machine, paths)
        code, table = _load(machine, self.name)
        return make_function(self.function.__name__, code, table, kinds, self._wrong)

    def _wrong(self, *args: object) -> NoReturn:
        raise KernelArgumentError(self.name, self.kinds or (), self._kinds(args))

    def _kinds(self, args: tuple[Any, ...]) -> tuple[str, ...]:
        """Say what each argument is: i, d or b, or an array's dtype and dimensions."""
        if len(args) != len(self._parameters):
            raise KernelArgumentError(self.name, self.kinds or (), (f"{len(args)} arguments",))
        kinds = []
        for parameter, value in zip(self._parameters, args, strict=True):
            annotation = parameter.annotation
            kind = _SCALARS.get(getattr(annotation, "__name__", annotation))
            if kind is None:
                kind = f"{value.dtype.str[1:]}:{value.ndim}"
                if not value.flags.c_contiguous:
                    kind += " not contiguous"
            kinds.append(kind)
        return tuple(kinds)

    # ---- what is kept ---------------------------------------------------------------------

    def _file(self, kinds: tuple[str, ...]) -> str:
        """Give a name that changes with all that the code depends on."""
        import llvmlite  # noqa: PLC0415 - only where there are kernels
        import llvmlite.binding as llvm  # noqa: PLC0415

        source = b"".join(path.read_bytes() for path in sorted(_files(self.function)))
        constants = sorted(_constants(self.function).items())
        features = sorted(n for n, there in llvm.get_host_cpu_features().items() if there)
        # Each numba belongs to one llvmlite.
        version = _FORMAT, self.unlocked, llvmlite.__version__, sys.implementation.cache_tag
        on = repr((version, llvm.get_host_cpu_name(), features, kinds, constants))
        digest = hashlib.sha256(source + on.encode()).hexdigest()[:20]
        return f"{self.name}.{digest}.kernel"

    def _places(self) -> list[Path]:
        """Where code may be kept: beside the module, else in the user's cache."""
        places = [Path(self.function.__code__.co_filename).parent / "__pycache__"]
        with contextlib.suppress(RuntimeError):  # a user without a home
            cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
            places.append(Path(cache) / "sweepctl")
        return places


def _files(function: Callable[..., Any]) -> set[Path]:
    """Where a kernel and those that it calls stand."""
    found = {Path(function.__code__.co_filename)}
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if callable(value) and value in KERNELS:
            found |= _files(KERNELS[value].function)
    return found


def _constants(function: Callable[..., Any]) -> dict[str, Any]:
    """Numbers of other modules that a kernel and those it calls are compiled with, by name."""
    found: dict[str, Any] = {}
    scope = function.__globals__
    named = function.__code__.co_names
    for name in named:
        value = scope.get(name)
        if isinstance(value, int | float):
            found[f"{function.__module__}.{name}"] = value
        elif isinstance(value, types.ModuleType) and value.__name__ != "math":
            kept = {n: getattr(value, n, None) for n in named}
            own = {n: v for n, v in kept.items() if isinstance(v, int | float)}
            found.update({f"{value.__name__}.{n}": v for n, v in own.items()})
        elif callable(value) and value in KERNELS:
            found.update(_constants(KERNELS[value].function))
    return found


def keep(code: bytes, paths: list[Path]) -> Path:
    """Write machine code to the first of the paths that can be written, whole or not at all.

    Raises:
        OSError: it can be written at none of them.

    """
    for at, path in enumerate(paths):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            number, made = tempfile.mkstemp(dir=path.parent)
            try:
                with open(number, "wb") as file:  # noqa: PTH123 - its number, not its name
                    file.write(_SEAL.pack(_MAGIC, len(code), _digest(path.name, code)) + code)
                # Others may use what root installed; nobody but its owner may change it.
                Path(made).chmod(0o644)
                Path(made).replace(path)
            except BaseException:
                Path(made).unlink(missing_ok=True)
                raise
        except OSError:
            if at + 1 == len(paths):
                raise
        else:
            return path
    raise AssertionError  # pragma: no cover - there is a path


def kept(path: Path, owners: Collection[int]) -> bytes | None:
    """Read machine code that ``keep`` wrote; None: it is not there, not whole, or not trusted.

    Damaged code would end the process, and code of others would run as ours: a file counts that
    this user or one of ``owners`` wrote and that nobody else may write.
    """
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            whole = file.read()
    except OSError:
        return None
    if sys.platform != "win32":
        is_ours = status.st_uid in owners or status.st_uid == os.geteuid()
        if not is_ours or status.st_mode & _FOREIGN_WRITABLE:
            return None
    if len(whole) < _SEAL.size:
        return None
    magic, length, digest = _SEAL.unpack_from(whole)
    code = whole[_SEAL.size :]
    is_whole = magic == _MAGIC and length == len(code) and digest == _digest(path.name, code)
    return code if is_whole else None


def _digest(name: str, code: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + code).digest()


def _load(code: bytes, name: str) -> tuple[int, int]:
    """Bring machine code into the process: addresses of its entry and of its types."""
    import llvmlite.binding as llvm  # noqa: PLC0415 - only where there are kernels

    if not _engines:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        # For when a count of references falls to 0, which those of a caller's arrays never do.
        llvm.add_symbol("NRT_MemInfo_call_dtor", 1)
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return engine.get_function_address(name), engine.get_global_value_address(f"{name}.types")
