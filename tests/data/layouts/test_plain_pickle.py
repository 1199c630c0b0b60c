"""Pickles are read without being run: plain values come back, everything else is refused."""

from __future__ import annotations

import os
import pickle
import pickletools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.layouts import plain_pickle
from gdg.data.layouts.plain_pickle import read_plain_pickle, unwrapped
from gdg.errors import GdgError

NUMBERS = st.one_of(st.integers(-(2**70), 2**70), st.floats(allow_nan=False), st.booleans())
VALUES = st.recursive(
    st.one_of(NUMBERS, st.none(), st.text(max_size=5), st.binary(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.text(max_size=3), inner, max_size=4),
        st.tuples(inner, inner),
    ),
    max_leaves=20,
)


@given(VALUES, st.sampled_from((3, 4, 5)))
def test_plain_values_come_back(value: Any, protocol: int) -> None:
    assert read_plain_pickle(pickle.dumps(value, protocol), "file") == value


@pytest.mark.parametrize("protocol", [3, 4])
def test_arrays_and_scalars_of_numpy_come_back(protocol: int) -> None:
    entries = np.array([{"x": np.float64(1.5), "y": np.float32(0.5), "n": np.int64(7)}] * 2)
    entries[0]["a"] = np.arange(6.0).reshape(2, 3).astype(">f4")
    read = read_plain_pickle(pickle.dumps(entries, protocol), "file")
    assert [(row["x"], row["y"], row["n"]) for row in read] == [(1.5, 0.5, 7)] * 2
    np.testing.assert_array_equal(unwrapped(read[0]["a"]), np.arange(6.0).reshape(2, 3))


class Calls:
    """Pickles into a call."""

    def __init__(self, function: Any, *arguments: Any):
        self.call = (function, arguments)

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("nested", [False, True])
def test_a_call_is_refused_and_never_made(tmp_path: Path, protocol: int, nested: bool) -> None:
    target = tmp_path / "made"
    for payload in (
        Calls(os.system, f"touch {target}"),
        Calls(eval, f"open({str(target)!r}, 'w')"),
    ):
        value = [{"qpos": {"x": payload}}] if nested else payload
        with pytest.raises(GdgError, match="never code"):
            read_plain_pickle(pickle.dumps(value, protocol), "file")
    assert not target.exists()


class Plain:
    """An ordinary class."""


@pytest.mark.parametrize(
    "value", [Plain(), np.random.default_rng(0), range(3), {1, 2}, complex(1, 2), Path("/"), print]
)
def test_other_objects_are_refused(value: Any) -> None:
    with pytest.raises(GdgError, match=r"file: is refused: gdg reads only plain values"):
        read_plain_pickle(pickle.dumps(value, 4), "file")


def test_numpy_functions_can_not_be_called_with_anything_else() -> None:
    scalar = np.float64(1).__reduce__()[0]
    for call in (
        Calls(scalar, np.dtype("O"), b"x" * 8),
        Calls(scalar, np.dtype("f8,f8"), b"x" * 16),
        Calls(scalar, np.dtype("f8"), b"short"),
        Calls(np.ndarray, (10**12,)),
        Calls(np.zeros(1).__reduce__()[0], list, (0,), b"b"),
    ):
        with pytest.raises(GdgError, match="never code"):
            read_plain_pickle(pickle.dumps(call, 4), "file")


@pytest.mark.parametrize("shape", ["(J\x00\x00\x00\x7ft", "(J\xff\xff\xff\xfft"])
def test_an_array_larger_than_its_data_is_refused(shape: str) -> None:
    data = pickle.dumps(np.zeros(1), 3)
    assert b"K\x01\x85" in data
    with pytest.raises(GdgError, match="never code"):
        read_plain_pickle(data.replace(b"K\x01\x85", shape.encode("latin1")), "file")


def test_an_endless_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain_pickle, "MAX_INSTRUCTIONS", 100)
    with pytest.raises(GdgError, match="more instructions"):
        read_plain_pickle(pickle.dumps(list(range(1000)), 4), "file")


def refusal(data: bytes) -> str:
    """Why a pickle is refused; "" if it is not."""
    try:
        read_plain_pickle(data, "file")
    except GdgError as error:
        return str(error)
    return ""


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_in_one_sentence(data: bytes) -> None:
    told = refusal(b"\x80\x04" + data)
    assert "\n" not in told


@given(st.data())
def test_a_damaged_file_is_refused_or_read(data: st.DataObject) -> None:
    whole = bytearray(pickle.dumps(np.array([{"qpos": {"x": np.float64(1.0)}, "s": 2}] * 3), 4))
    place = data.draw(st.integers(0, len(whole) - 1))
    whole[place] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    for damaged in (bytes(whole), bytes(whole[:cut])):
        assert refusal(damaged).startswith("file: is refused") or refusal(damaged) == ""


def test_the_reader_knows_no_opcode_that_calls_a_class() -> None:
    forbidden = {
        "INST",
        "OBJ",
        "NEWOBJ",
        "NEWOBJ_EX",
        "PERSID",
        "BINPERSID",
        "EXT1",
        "EXT2",
        "EXT4",
    }
    known = {*plain_pickle._ACTIONS, *plain_pickle._PUSHES}
    assert not forbidden & known
    assert known <= {opcode.name for opcode in pickletools.opcodes}


@pytest.mark.parametrize("shape", [b"h\x00", b"(h\x00t"])
@pytest.mark.parametrize("dtype", [b"O8", b"f8"])
def test_a_shape_that_explodes_in_print_is_refused_at_once(shape: bytes, dtype: bytes) -> None:
    bomb = b")q\x00" + b"h\x00\x86q\x00" * 60  # a pair of pairs of pairs, 60 deep
    array = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00tR"
    kind = b"cnumpy\ndtype\n(X\x02\x00\x00\x00" + dtype + b"tR"
    content = b"]" if dtype == b"O8" else b"C\x08" + bytes(8)
    data = b"\x80\x03" + array + b"(" + bomb + shape + kind + b"\x89" + content + b"tb."
    assert re.search("in place of a int|more than one axis", refusal(data))


@pytest.mark.parametrize("code", ["f8,(", "(" * 300, "O8,f8", "S3", "f99", "(2,3)f8"])
def test_a_dtype_of_anything_but_numbers_is_refused(code: str) -> None:
    text = code.encode()
    data = (
        b"\x80\x03cnumpy.core.multiarray\nscalar\n(cnumpy\ndtype\n(X"
        + len(text).to_bytes(4, "little") + text + b"tRC\x08" + bytes(8) + b"tR."
    )  # fmt: skip
    assert "is refused" in refusal(data)
