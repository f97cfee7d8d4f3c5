"""How Python calls a kernel: a function of CPython's own calling convention, written for LLVM.

Its text checks and unpacks what was passed, calls the kernel's code and packs what comes back,
in a tenth of the time that ctypes takes for it. Arrays are read through numpy's documented
structure (``PyArrayObject_fields`` of its C API), and only if they are what the kernel was
compiled for; anything else goes to a Python function that says what is wrong.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

METH_FASTCALL = 0x0080
_TYPE, _DATA, _NDIM, _SHAPE, _DESCR, _FLAGS = 8, 16, 24, 32, 56, 64
"""Offsets in a Python object and in an array, on a 64-bit machine."""
_CONTIGUOUS = 0x0001
ARRAYS = {"f8": np.float64, "i8": np.int64, "i4": np.int32, "u1": np.uint8, "b1": np.bool_}
"""By the name that a kind begins with."""

_HEAD = """
declare double @PyFloat_AsDouble(ptr)
declare i64 @PyLong_AsLongLong(ptr)
declare i32 @PyObject_IsTrue(ptr)
declare ptr @PyErr_Occurred()
declare ptr @PyFloat_FromDouble(double)
declare ptr @PyLong_FromLongLong(i64)
declare ptr @PyBool_FromLong(i64)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)
declare void @Py_IncRef(ptr)
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
@_Py_NoneStruct = external global i8
"""


def layout_is_known() -> bool:
    """Whether objects and arrays of this Python lie as this module reads them."""
    probe = np.zeros((2, 3))

    def word(offset: int) -> int:
        return ctypes.c_int64.from_address(id(probe) + offset).value

    return (
        ctypes.sizeof(ctypes.c_void_p) == 8  # noqa: PLR2004 - bytes of a pointer
        and word(_TYPE) == id(np.ndarray)
        and word(_DATA) == probe.ctypes.data
        and word(_NDIM) & 0xFFFF_FFFF == probe.ndim
        and ctypes.c_int64.from_address(word(_SHAPE) + 8).value == probe.shape[1]
        and word(_DESCR) == id(np.dtype(np.float64))
        and bool(word(_FLAGS) & _CONTIGUOUS)
    )


def wrapper_text(
    symbol: str, name: str, kinds: tuple[str, ...], results: list[str], *, unlocked: bool = False
) -> str:
    """Write the LLVM text of the function ``name``, which calls the code at ``symbol``.

    Where ``unlocked``, without the interpreter's lock: the caller's references keep the arrays.
    ``kinds`` and ``results`` are as in ``compiled``. The text has a global ``name.types`` that
    ``make_function`` fills in: the addresses of numpy's array type and of each array's dtype.
    """
    ints = [r for r in results if r != "d"]
    floats = [r for r in results if r == "d"]
    c_types = ["ptr", "ptr"]
    passed = ["ptr %nothing", "ptr %nothing"]
    body = [
        f"  %count = icmp eq i64 %nargs, {len(kinds)}",
        "  br i1 %count, label %arg0, label %wrong",
    ]
    rooms = []
    for room, values, kind in (("ri", ints, "i64"), ("rd", floats, "double")):
        if values:
            rooms.append(f"  %{room} = alloca [{len(values)} x {kind}]")
            c_types.append("ptr")
            passed.append(f"ptr %{room}")
    scalars = False
    for at, kind in enumerate(kinds):
        body += [
            f"arg{at}:",
            f"  %p{at} = getelementptr ptr, ptr %args, i64 {at}",
            f"  %o{at} = load ptr, ptr %p{at}",
        ]
        follow = f"arg{at + 1}"
        _, colon, dimensions = kind.partition(":")
        if colon:
            body += _array_text(at, name, int(dimensions), follow)
            passed.append(f"ptr %data{at}")
            c_types.append("ptr")
            for i in range(int(dimensions)):
                passed.append(f"i64 %n{at}_{i}")
                c_types.append("i64")
            continue
        scalars = True
        if kind == "d":
            body.append(f"  %v{at} = call double @PyFloat_AsDouble(ptr %o{at})")
            passed.append(f"double %v{at}")
            c_types.append("double")
        elif kind == "i":
            body.append(f"  %v{at} = call i64 @PyLong_AsLongLong(ptr %o{at})")
            passed.append(f"i64 %v{at}")
            c_types.append("i64")
        else:
            body += [
                f"  %b{at} = call i32 @PyObject_IsTrue(ptr %o{at})",
                f"  %v{at} = trunc i32 %b{at} to i8",
            ]
            passed.append(f"i8 %v{at}")
            c_types.append("i8")
        body.append(f"  br label %{follow}")
    body.append(f"arg{len(kinds)}:")
    if scalars:
        body += [
            "  %error = call ptr @PyErr_Occurred()",
            "  %failed = icmp ne ptr %error, null",
            "  br i1 %failed, label %raised, label %go",
            "raised:",
            "  ret ptr null",
            "go:",
        ]
    call = f'  call i32 @"{symbol}"({", ".join(passed)})'
    save, restore = "  %thread = call ptr @PyEval_SaveThread()", "PyEval_RestoreThread(ptr %thread)"
    body += [save, call, f"  call void @{restore}"] if unlocked else [call]
    body += _result_text(results)
    body += [
        "wrong:",
        "  %said = call ptr @PyObject_Vectorcall(ptr %self, ptr %args, i64 %nargs, ptr null)",
        "  ret ptr %said",
    ]
    return (
        _HEAD
        + f'declare i32 @"{symbol}"({", ".join(c_types)})\n'
        + f'@"{name}.types" = global [{1 + len(kinds)} x ptr] zeroinitializer\n'
        + f'define ptr @"{name}"(ptr %self, ptr %args, i64 %nargs) {{\n'
        + "  %nothing = alloca [2 x ptr]\n"
        + "\n".join(rooms + body)
        + "\n}\n"
    )


def _array_text(at: int, name: str, dimensions: int, follow: str) -> list[str]:
    """Check one array and read its address and sizes."""

    def field(what: str, kind: str, offset: int) -> list[str]:
        return [
            f"  %{what}p{at} = getelementptr i8, ptr %o{at}, i64 {offset}",
            f"  %{what}{at} = load {kind}, ptr %{what}p{at}",
        ]

    return [
        *field("type", "ptr", _TYPE),
        f'  %isarray{at} = load ptr, ptr @"{name}.types"',
        f"  %t{at} = icmp eq ptr %type{at}, %isarray{at}",
        f"  br i1 %t{at}, label %array{at}, label %wrong",
        f"array{at}:",
        *field("descr", "ptr", _DESCR),
        f'  %wantp{at} = getelementptr ptr, ptr @"{name}.types", i64 {1 + at}',
        f"  %want{at} = load ptr, ptr %wantp{at}",
        f"  %d{at} = icmp eq ptr %descr{at}, %want{at}",
        *field("ndim", "i32", _NDIM),
        f"  %e{at} = icmp eq i32 %ndim{at}, {dimensions}",
        *field("flags", "i32", _FLAGS),
        f"  %contiguous{at} = and i32 %flags{at}, {_CONTIGUOUS}",
        f"  %f{at} = icmp ne i32 %contiguous{at}, 0",
        f"  %de{at} = and i1 %d{at}, %e{at}",
        f"  %fits{at} = and i1 %de{at}, %f{at}",
        f"  br i1 %fits{at}, label %fits_{at}, label %wrong",
        f"fits_{at}:",
        *field("data", "ptr", _DATA),
        *field("shape", "ptr", _SHAPE),
        *[
            line
            for i in range(dimensions)
            for line in (
                f"  %np{at}_{i} = getelementptr i64, ptr %shape{at}, i64 {i}",
                f"  %n{at}_{i} = load i64, ptr %np{at}_{i}",
            )
        ],
        f"  br label %{follow}",
    ]


def _result_text(results: list[str]) -> list[str]:
    """Make Python's objects of what the kernel wrote."""
    if not results:
        return ["  call void @Py_IncRef(ptr @_Py_NoneStruct)", "  ret ptr @_Py_NoneStruct"]
    lines = []
    at = {"ri": 0, "rd": 0}
    for index, kind in enumerate(results):
        room, c_type = ("rd", "double") if kind == "d" else ("ri", "i64")
        make = {"d": "PyFloat_FromDouble", "i": "PyLong_FromLongLong", "b": "PyBool_FromLong"}[kind]
        lines += [
            f"  %rp{index} = getelementptr {c_type}, ptr %{room}, i64 {at[room]}",
            f"  %rv{index} = load {c_type}, ptr %rp{index}",
            f"  %r{index} = call ptr @{make}({c_type} %rv{index})",
        ]
        at[room] += 1
    if len(results) == 1:
        return [*lines, "  ret ptr %r0"]
    lines.append(f"  %tuple = call ptr @PyTuple_New(i64 {len(results)})")
    lines += [
        f"  call i32 @PyTuple_SetItem(ptr %tuple, i64 {i}, ptr %r{i})" for i in range(len(results))
    ]
    return [*lines, "  ret ptr %tuple"]


class _MethodDef(ctypes.Structure):
    """``PyMethodDef``."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("code", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_definitions: list[_MethodDef] = []
"""As long as the process: a function points to its own."""


def make_function(
    name: str, code: int, types: int, kinds: tuple[str, ...], wrong: Callable[..., Any]
) -> Callable[..., Any]:
    """Make Python's function of the code at an address.

    Args:
        name: What it is called.
        code: Address of the function that ``wrapper_text`` describes.
        types: Address of its global.
        kinds: Of its arguments.
        wrong: Called instead, with the same arguments, where they do not fit.

    """
    known = [id(np.ndarray)] + [
        id(np.dtype(ARRAYS[kind.partition(":")[0]])) if ":" in kind else 0 for kind in kinds
    ]
    for at, address in enumerate(known):
        ctypes.c_int64.from_address(types + 8 * at).value = address
    definition = _MethodDef(name.encode(), code, METH_FASTCALL, None)
    _definitions.append(definition)
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.argtypes = ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p
    new.restype = ctypes.py_object
    function: Callable[..., Any] = new(ctypes.addressof(definition), wrong, None)
    return function
