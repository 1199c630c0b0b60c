"""Reads pickles that hold nothing but plain values and numpy arrays, without running them.

``pickle`` lets a file call any function. This reader is a small stack machine of its own: it knows
the opcodes that build numbers, strings, lists, tuples and dictionaries, and the three calls by
which numpy's arrays, dtypes and scalars are written, which it performs itself. Everything else is
refused unread, so nothing of a file is ever called or imported.
"""

from __future__ import annotations

import pickletools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gdg.errors import GdgError

#: More instructions than this are no dataset file's (500 grasps take 50 000).
MAX_INSTRUCTIONS = 20_000_000
#: dtypes that scalars and inner arrays may have: booleans, integers and floats.
CODE = re.compile(r"[<>=|]?[biuf][0-9]{1,2}")
#: Modules under which numpy's versions write their functions.
CORES = ("numpy.core.multiarray", "numpy._core.multiarray")


@dataclass(frozen=True)
class _Name:
    """A function or class that the file names; never looked up."""

    module: str
    name: str


@dataclass
class _Dtype:
    code: str
    order: str = "="

    def numpy(self) -> np.dtype[Any]:
        if not CODE.fullmatch(self.code):
            raise ValueError(f"values of dtype '{self.code[:40]}'")
        dtype = np.dtype(self.code)
        if self.order in ("<", ">"):
            return np.dtype(self.order + dtype.str[1:])
        return dtype


@dataclass
class _Array:
    """An array before and after its content is known."""

    content: Any = None


@dataclass
class _Machine:
    stack: list[Any] = field(default_factory=list)
    marks: list[int] = field(default_factory=list)
    memo: dict[int, Any] = field(default_factory=dict)

    def since_mark(self) -> list[Any]:
        start = self.marks.pop()
        items = self.stack[start:]
        del self.stack[start:]
        return items


def read_plain_pickle(data: bytes, source: str) -> Any:
    """The plain value that a pickle holds.

    Arrays of numbers come back as numpy arrays, arrays of objects (one axis) as lists.

    Args:
        data: the pickle.
        source: the file's name, for the message.

    Raises:
        GdgError: the pickle is cut off, or holds anything but plain values and arrays of numbers.
    """
    machine = _Machine()
    try:
        for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
            if count > MAX_INSTRUCTIONS:
                raise ValueError("more instructions than any dataset has")
            if opcode.name == "STOP":
                (value,) = machine.stack
                return unwrapped(value)
            if opcode.name in _PUSHES:
                machine.stack.append(argument)
            elif opcode.name in _ACTIONS:
                _ACTIONS[opcode.name](machine, argument)
            else:
                raise ValueError(f"the instruction {opcode.name}")
        raise ValueError("it is cut off")
    except (
        ValueError,
        TypeError,
        IndexError,
        KeyError,
        OverflowError,
        MemoryError,
        RecursionError,
    ) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise GdgError(
            f"{source}: is refused: gdg reads only plain values and arrays of numbers from such "
            f"files, never code, and met {reason}."
        ) from error


def unwrapped(value: Any) -> Any:
    """The content of an array, any other value as it is."""
    return value.content if isinstance(value, _Array) else value


# -- opcodes ----------------------------------------------------------------------------------

#: Opcodes that push their own argument.
_PUSHES = frozenset(
    (
        *("BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES"),
        *("BINBYTES8", "BINFLOAT", "BININT", "BININT1", "BININT2", "LONG1"),
    )
)


def _push(value: Callable[[], Any]) -> Callable[[_Machine, Any], None]:
    return lambda machine, _: machine.stack.append(value())


def _nothing(machine: _Machine, argument: Any) -> None:
    return


def _mark(machine: _Machine, argument: Any) -> None:
    machine.marks.append(len(machine.stack))


def _tuple(size: int) -> Callable[[_Machine, Any], None]:
    def action(machine: _Machine, _: Any) -> None:
        if size > len(machine.stack):
            raise IndexError("too few values")
        items = tuple(machine.stack[-size:])
        del machine.stack[-size:]
        machine.stack.append(items)

    return action


def _tuple_since_mark(machine: _Machine, argument: Any) -> None:
    items = tuple(machine.since_mark())
    machine.stack.append(items)


def _append(machine: _Machine, argument: Any) -> None:
    item = machine.stack.pop()
    _of(list, machine.stack[-1]).append(item)


def _appends(machine: _Machine, argument: Any) -> None:
    items = machine.since_mark()
    _of(list, machine.stack[-1]).extend(items)


def _set_item(machine: _Machine, argument: Any) -> None:
    value, key = machine.stack.pop(), machine.stack.pop()
    _of(dict, machine.stack[-1])[_of(str, key)] = value


def _set_items(machine: _Machine, argument: Any) -> None:
    items = machine.since_mark()
    target = _of(dict, machine.stack[-1])
    for key, value in zip(items[::2], items[1::2], strict=True):
        target[_of(str, key)] = value


def _memoize(machine: _Machine, argument: Any) -> None:
    machine.memo[len(machine.memo)] = machine.stack[-1]


def _put(machine: _Machine, argument: Any) -> None:
    machine.memo[argument] = machine.stack[-1]


def _get(machine: _Machine, argument: Any) -> None:
    machine.stack.append(machine.memo[argument])


def _global(machine: _Machine, argument: str) -> None:
    module, _, name = argument.partition(" ")
    _name(machine, module, name)


def _stack_global(machine: _Machine, argument: Any) -> None:
    name, module = machine.stack.pop(), machine.stack.pop()
    _name(machine, _of(str, module), _of(str, name))


def _name(machine: _Machine, module: str, name: str) -> None:
    known = (module in CORES and name in ("_reconstruct", "scalar")) or (
        module == "numpy" and name in ("ndarray", "dtype")
    )
    if not known:
        raise ValueError(f"'{module[:60]}.{name[:60]}'")
    machine.stack.append(_Name(module, name))


def _call(machine: _Machine, argument: Any) -> None:
    arguments, function = _of(tuple, machine.stack.pop()), _of(_Name, machine.stack.pop())
    if function.name == "dtype":
        machine.stack.append(_Dtype(_of(str, arguments[0])))
    elif function.name == "scalar":
        dtype, data = arguments
        machine.stack.append(_numbers(_of(_Dtype, dtype), _of(bytes, data), (1,)).item())
    elif function.name == "_reconstruct" and arguments[0] == _Name("numpy", "ndarray"):
        machine.stack.append(_Array())  # its own arguments say nothing: the state follows
    else:
        raise ValueError(f"a call of '{function.module}.{function.name}'")


def _build(machine: _Machine, argument: Any) -> None:
    state, target = _of(tuple, machine.stack.pop()), machine.stack[-1]
    if isinstance(target, _Dtype):
        target.order = _of(str, state[1])
    elif isinstance(target, _Array) and target.content is None:
        _, shape, dtype, fortran, content = state
        target.content = _array_content(_of(tuple, shape), _of(_Dtype, dtype), fortran, content)
    else:
        raise ValueError(f"a state for a {type(target).__name__}")


def _array_content(shape: tuple[Any, ...], dtype: _Dtype, fortran: Any, content: Any) -> Any:
    if dtype.code.startswith("O"):
        values = _of(list, content)
        if len(shape) > 1 or [len(values)] != (_sizes(shape) or [1]):
            raise ValueError("an array of objects of more than one axis, or of another length")
        return values
    if len(shape) > 1 and fortran:
        raise ValueError("an array stored by columns")
    return _numbers(dtype, _of(bytes, content), shape)


def _numbers(dtype: _Dtype, data: bytes, shape: tuple[Any, ...]) -> np.ndarray:
    return np.frombuffer(data, dtype.numpy()).reshape(_sizes(shape))


def _sizes(shape: tuple[Any, ...]) -> list[int]:
    sizes = [_of(int, size) for size in shape]
    if min(sizes, default=0) < 0:
        raise ValueError("an array with a negative number of values")
    return sizes


def _of(kind: type[Any], value: Any) -> Any:
    if type(value) is not kind:
        raise TypeError(f"a {type(value).__name__} in place of a {kind.__name__}")
    return value


_ACTIONS: dict[str, Callable[[_Machine, Any], None]] = {
    "PROTO": _nothing,
    "FRAME": _nothing,
    "MARK": _mark,
    "NONE": _push(lambda: None),
    "NEWTRUE": _push(lambda: True),
    "NEWFALSE": _push(lambda: False),
    "EMPTY_LIST": _push(list),
    "EMPTY_DICT": _push(dict),
    "EMPTY_TUPLE": _push(tuple),
    "TUPLE": _tuple_since_mark,
    "TUPLE1": _tuple(1),
    "TUPLE2": _tuple(2),
    "TUPLE3": _tuple(3),
    "APPEND": _append,
    "APPENDS": _appends,
    "SETITEM": _set_item,
    "SETITEMS": _set_items,
    "MEMOIZE": _memoize,
    "BINPUT": _put,
    "LONG_BINPUT": _put,
    "BINGET": _get,
    "LONG_BINGET": _get,
    "GLOBAL": _global,
    "STACK_GLOBAL": _stack_global,
    "REDUCE": _call,
    "BUILD": _build,
}
