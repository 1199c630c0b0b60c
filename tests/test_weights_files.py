"""Weights files: what is written comes back, and what isn't ours is refused by name."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from gdg.errors import GdgError
from gdg.weights_files import check_state, find_weights, read_weights, write_weights

SCHEMA, REQUIRED = "gdg-test-1", {"distance": "which distance it was trained with"}


def write(path: Path, **metadata: object) -> dict[str, torch.Tensor]:
    state = {"a.weight": torch.randn(3, 4).T, "steps": torch.tensor(7)}
    write_weights(path, state, SCHEMA, {"distance": "aligned/release", **metadata})
    return state


def test_tensors_and_metadata_come_back(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    state = write(path, objects=["mug"], schema="not this one")
    read = read_weights(path, SCHEMA, REQUIRED)
    assert read.metadata == {"distance": "aligned/release", "objects": ["mug"]}
    assert len(read.sha256) == 64
    assert set(read.state) == set(state)
    assert all(torch.equal(read.state[name], tensor) for name, tensor in state.items())


def test_half_precision_is_for_floating_point_numbers_only(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    state = {"weight": torch.tensor([0.5, 3.0]), "steps": torch.tensor(70_000)}
    write_weights(path, state, SCHEMA, {"distance": "d"}, dtype=torch.float16)
    read = read_weights(path, SCHEMA, {}).state
    assert (read["weight"].dtype, read["steps"].item()) == (torch.float16, 70_000)


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_file_is_as_readable_as_any_new_one(tmp_path: Path) -> None:
    write(tmp_path / "a.safetensors")
    (tmp_path / "plain").touch()
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("a.safetensors", "plain")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x08\x00\x00\x00\x00\x00\x00\x00{}      "])
def test_broken_files_and_missing_metadata_are_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.safetensors"
    path.write_bytes(content)
    with pytest.raises(GdgError, match=r"broken\.safetensors: "):
        read_weights(path, SCHEMA, REQUIRED)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (None, "doesn't say which distance"),
        ("[1]", "doesn't say which distance"),
        ("{", "no readable safetensors file"),
        (json.dumps({"schema": SCHEMA, "distance": 3}), "doesn't say which distance"),
        (json.dumps({"schema": "other-1", "distance": "d"}), "schema is 'other-1', expected"),
    ],
)
def test_foreign_metadata_is_refused(tmp_path: Path, metadata: str | None, message: str) -> None:
    path = tmp_path / "foreign.safetensors"
    save_file({"a": torch.zeros(1)}, path, metadata={"gdg": metadata} if metadata else None)
    with pytest.raises(GdgError, match=message):
        read_weights(path, SCHEMA, REQUIRED)


def test_large_file_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "a.safetensors")
    monkeypatch.setattr("gdg.weights_files.MAX_BYTES", 10)
    with pytest.raises(GdgError, match="is larger than"):
        read_weights(tmp_path / "a.safetensors", SCHEMA, REQUIRED)


def test_weights_are_found_by_bundled_name_or_path(tmp_path: Path) -> None:
    write(tmp_path / "full.safetensors")
    path = tmp_path / "full.safetensors"
    assert find_weights("full", tmp_path, "generator.weights") == path
    assert find_weights(str(path), tmp_path / "none", "generator.weights") == path
    with pytest.raises(GdgError, match=r"no bundled weights 'ful'.* Did you mean 'full'"):
        find_weights("ful", tmp_path, "generator.weights")
    with pytest.raises(GdgError, match=r"planner\.weights: there is no file 'no\.pth'"):
        find_weights("no.pth", tmp_path, "planner.weights", {".pth": "a released file"})
    with pytest.raises(GdgError, match=r"No weights are bundled.*'gdg train', or of a released"):
        find_weights("x", tmp_path / "none", "generator.weights", {".pth": "a released file"})


def test_tensors_that_do_not_fit_are_named(tmp_path: Path) -> None:
    path, expected = tmp_path / "a.safetensors", {"a": torch.zeros(2), "b": torch.zeros(3)}
    check_state(path, dict(expected), expected)
    cases = (
        ({"a": torch.zeros(2)}, "'b' is missing"),
        ({**expected, "a": torch.zeros(4)}, r"'a' has shape \(4,\) instead of \(2,\)"),
        ({**expected, "a": torch.full((2,), torch.nan)}, "'a' holds numbers that are not finite"),
        ({**expected, "c": torch.zeros(1)}, "it has no tensor 'c'"),
    )
    for state, message in cases:
        with pytest.raises(GdgError, match=message):
            check_state(path, state, expected)
