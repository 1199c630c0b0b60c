"""The cache never gives wrong arrays, whatever lies on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gdg.cache import cache_directory, cached_arrays, content_hash
from gdg.errors import GdgError

ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(7)}


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GDG_CACHE", str(tmp_path))
    return tmp_path


def counting() -> tuple[list[int], Callable[[], dict[str, np.ndarray]]]:
    calls: list[int] = []

    def compute() -> dict[str, np.ndarray]:
        calls.append(1)
        return ARRAYS

    return calls, compute


def assert_same(arrays: object) -> None:
    assert isinstance(arrays, dict)
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)


def test_arrays_are_computed_once():
    calls, compute = counting()
    assert_same(dict(cached_arrays("kind", "key", compute)))
    assert_same(dict(cached_arrays("kind", "key", compute)))
    assert len(calls) == 1


def test_keys_and_kinds_are_apart():
    calls, compute = counting()
    for kind, key in (("k", "a"), ("k", "b"), ("l", "a")):
        cached_arrays(kind, key, compute)
    assert len(calls) == 3


def test_a_truncated_file_is_computed_anew(own_cache: Path):
    calls, compute = counting()
    cached_arrays("kind", "key", compute)
    path = own_cache / "kind" / "key.npz"
    whole = path.read_bytes()
    for length in (0, 1, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert_same(dict(cached_arrays("kind", "key", compute)))
        assert path.read_bytes() == whole
    assert len(calls) == 6


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200))
def test_any_other_bytes_are_computed_anew(own_cache: Path, data: bytes):
    path = own_cache / "kind" / "key.npz"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    assert_same(dict(cached_arrays("kind", "key", lambda: ARRAYS)))


def test_a_bare_array_and_a_pickle_are_computed_anew(own_cache: Path):
    path = own_cache / "kind" / "key.npz"
    path.parent.mkdir()
    for array in (np.arange(3), np.array([{}], dtype=object)):
        with path.open("wb") as stream:
            np.save(stream, array)
        assert_same(dict(cached_arrays("kind", "key", lambda: ARRAYS)))


def test_nothing_is_left_behind_when_the_computation_fails(own_cache: Path):
    def fail() -> dict[str, np.ndarray]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_arrays("kind", "key", fail)
    assert not list(own_cache.rglob("*"))


def test_a_cache_that_cannot_be_written_says_what_to_do(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    (own_cache / "file").touch()
    monkeypatch.setenv("GDG_CACHE", str(own_cache / "file"))
    with pytest.raises(GdgError, match="Set GDG_CACHE"):
        cached_arrays("kind", "key", lambda: ARRAYS)


def test_a_full_disk_says_what_to_do_and_leaves_no_rest(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(*args: object, **kwargs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(GdgError, match="No space left"):
        cached_arrays("kind", "key", lambda: ARRAYS)
    assert not [path for path in own_cache.rglob("*") if path.is_file()]


def test_the_home_directory_is_expanded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("GDG_CACHE", "~/cache")
    assert cache_directory() == tmp_path / "cache"


def test_the_hash_tells_parts_and_their_borders_apart():
    hashes = [
        content_hash("ab", "c"), content_hash("a", "bc"), content_hash("abc"),
        content_hash("c", "ab"), content_hash(1), content_hash(1.0), content_hash("1"),
        content_hash(),
    ]  # fmt: skip
    assert len(set(hashes)) == len(hashes)
    assert content_hash("ab", 1, 0.5, b"x") == content_hash("ab", 1, 0.5, b"x")
