"""Makes machine code of a kernel, with numba; see ``compiled``, which alone uses it."""

from __future__ import annotations

import contextlib
import sys
import types
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm

from bridge.motion.compiled import KERNELS
from bridge.motion.kernel_call import wrapper_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bridge.motion.compiled import Kernel


@contextlib.contextmanager
def _left_out(*names: str) -> Iterator[None]:
    """Let nobody import these packages meanwhile, unless somebody has before."""
    hidden = [name for name in names if name not in sys.modules]
    for name in hidden:
        sys.modules[name] = None  # type: ignore[assignment]  # what says "do not look for it"
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


# Numba tries for all three as it starts: for the coverage of its own compiler, for products of
# matrices, of which the kernels have none, and for a file of settings.
with _left_out("coverage", "scipy", "yaml"):
    import numba
    import numba.np.arraymath
    from numba import carray  # type: ignore[attr-defined]  # numba does not say what it exports

Numba = Any
"""An object of numba's or LLVM's, which are untyped."""
kind_of: Numba = numba.types

_SCALARS: dict[str, Numba] = {"i": kind_of.int64, "d": kind_of.float64, "b": kind_of.boolean}
_ARRAYS: dict[str, Numba] = {
    "f8": kind_of.float64,
    "i8": kind_of.int64,
    "i4": kind_of.int32,
    "u1": kind_of.uint8,
    "b1": kind_of.boolean,
}
_FOREIGN = ("NRT_MemInfo_alloc", "NRT_Allocate", "numba_")
"""What calls of these begin with has no place in a kernel: allocation and exceptions."""
_dispatchers: dict[Kernel, Numba] = {}


class KernelError(Exception):
    """A kernel does what one cannot do."""

    def __init__(self, kernel: str, symbols: Sequence[str]) -> None:
        """``symbols``: what it calls."""
        super().__init__(
            f"kernel {kernel} allocates, raises or calls Python ({', '.join(symbols)}): "
            f"pass in what it needs room for"
        )


def build(kernel: Kernel, kinds: tuple[str, ...]) -> bytes:
    """Compile ``kernel`` for arguments of these kinds: an object file.

    It has a function of the kernel's name, as ``kernel_call`` describes it.

    Raises:
        KernelError: the kernel allocates or raises.

    """
    inner = dispatcher(kernel)
    signature = tuple(
        _SCALARS[kind]
        if kind in _SCALARS
        else kind_of.Array(_ARRAYS[kind.split(":")[0]], int(kind.split(":")[1]), "C")
        for kind in kinds
    )
    inner.compile(signature)
    results = _results(inner.overloads[signature].signature.return_type)
    entry, types_ = _entry(inner, kinds, results)
    outer = numba.cfunc(kind_of.void(*types_), error_model="numpy")(entry)
    symbol = outer.native_name.removeprefix("cfunc.")
    module = llvm.parse_assembly(outer.inspect_llvm())
    text = wrapper_text(symbol, kernel.name, kinds, results, unlocked=kernel.unlocked)
    module.link_in(llvm.parse_assembly(text))
    _strip(module, kernel.name)
    foreign = [f.name for f in module.functions if f.name.startswith(_FOREIGN)]
    if foreign:
        raise KernelError(kernel.name, foreign)
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        reloc="default",
        codemodel="jitdefault",
    )
    return bytes(machine.emit_object(module))


def dispatcher(kernel: Kernel) -> Numba:
    """Give numba's function of a kernel; kernels that it calls are such functions as well."""
    if kernel not in _dispatchers:
        function = kernel.function
        scope = dict(function.__globals__)
        copy = types.FunctionType(function.__code__, scope, function.__name__)
        _dispatchers[kernel] = numba.njit(error_model="numpy", nogil=kernel.unlocked)(copy)
        for name in function.__code__.co_names:
            callee = KERNELS.get(scope[name]) if callable(scope.get(name)) else None
            if callee is not None:
                scope[name] = dispatcher(callee)
    return _dispatchers[kernel]


def _results(kind: Numba) -> list[str]:
    """Say what comes back: i, d or b for each value."""
    if isinstance(kind, kind_of.NoneType):
        return []
    members = tuple(kind) if isinstance(kind, kind_of.BaseTuple) else (kind,)
    return [
        "b" if isinstance(m, kind_of.Boolean) else "i" if isinstance(m, kind_of.Integer) else "d"
        for m in members
    ]


def _entry(
    inner: Numba, kinds: tuple[str, ...], results: list[str]
) -> tuple[Callable[..., None], list[Numba]]:
    """Write a function of plain C arguments around a kernel; what it gives goes to memory."""
    parameters, passed, types_ = [], [], []
    for room, number in (("ri", kind_of.int64), ("rd", kind_of.float64)):
        if any(("rd" if r == "d" else "ri") == room for r in results):
            parameters.append(room)
            types_.append(kind_of.CPointer(number))
    for at, kind in enumerate(kinds):
        parameters.append(f"a{at}")
        dtype, colon, dimensions = kind.partition(":")
        if not colon:
            types_.append(_SCALARS[kind])
            passed.append(f"a{at}")
            continue
        sizes = [f"n{at}_{i}" for i in range(int(dimensions))]
        parameters += sizes
        types_ += [kind_of.CPointer(_ARRAYS[dtype]), *[kind_of.intp] * len(sizes)]
        passed.append(f"carray(a{at}, ({', '.join(sizes)},))")
    lines = [f"    got = inner({', '.join(passed)})"]
    at_room = {"ri": 0, "rd": 0}
    for at, kind in enumerate(results):
        room = "rd" if kind == "d" else "ri"
        value = "got" if len(results) == 1 else f"got[{at}]"
        lines.append(f"    {room}[{at_room[room]}] = {value}")
        at_room[room] += 1
    scope: dict[str, Numba] = {"inner": inner, "carray": carray}
    exec(f"def entry({', '.join(parameters)}):\n" + "\n".join(lines) + "\n", scope)  # noqa: S102 - our own text
    return scope["entry"], types_


def _strip(module: Numba, symbol: str) -> None:
    """Leave the entry and what it needs; numba's own wrapper for C talks with Python."""
    for function in module.functions:
        if not function.is_declaration and function.name != symbol:
            function.linkage = "internal"
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    options = llvm.create_pipeline_tuning_options()
    machine = llvm.Target.from_default_triple().create_target_machine()
    passes.run(module, llvm.create_pass_builder(machine, options))
