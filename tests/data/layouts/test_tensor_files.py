"""``.pt`` files are read without being run."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import pytest
import torch

from gdg.data.layouts import tensor_files
from gdg.data.layouts.tensor_files import read_tensor_file
from gdg.errors import GdgError


class Calls:
    """Pickles into a call of ``os.system``."""

    def __init__(self, command: str):
        self.command = command

    def __reduce__(self) -> Any:
        return os.system, (self.command,)


def test_tensors_and_plain_values_come_back(tmp_path: Path) -> None:
    tree = {"info": {"n": 1, "of": ["a"]}, "metadata": [(torch.arange(3.0), "mug", "hand")]}
    torch.save(tree, tmp_path / "a.pt")
    read = read_tensor_file(tmp_path / "a.pt")
    assert read["info"] == tree["info"]
    assert read["metadata"][0][0].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("zipped", [True, False])
def test_a_file_with_code_is_refused_and_not_run(tmp_path: Path, zipped: bool) -> None:
    path, made = tmp_path / "evil.pt", tmp_path / "made"
    torch.save({"metadata": [Calls(f"touch {made}")]}, path, _use_new_zipfile_serialization=zipped)
    with pytest.raises(GdgError, match=r"evil.pt: is refused: .* names 'posix.system'"):
        read_tensor_file(path)
    assert not made.exists()


@pytest.mark.parametrize("content", [b"", b"no pickle", b"\x80\x02]q"])
def test_what_is_no_such_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.pt").write_bytes(content)
    with pytest.raises(GdgError, match=r"a.pt: is refused"):
        read_tensor_file(tmp_path / "a.pt")


def test_a_compressed_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.pt"
    torch.save(torch.zeros(100_000), tmp_path / "a.pt")
    with zipfile.ZipFile(tmp_path / "a.pt") as plain, zipfile.ZipFile(path, "w", 8) as bomb:
        for entry in plain.namelist():
            bomb.writestr(entry, plain.read(entry))
    with pytest.raises(GdgError, match="is compressed"):
        read_tensor_file(path)


def test_a_file_that_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.save(torch.zeros(1000), tmp_path / "a.pt")
    monkeypatch.setattr(tensor_files, "MAX_BYTES", 1000)
    with pytest.raises(GdgError, match="is larger than"):
        read_tensor_file(tmp_path / "a.pt")


def test_a_file_of_the_old_kind_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.pt"
    torch.save({"metadata": [torch.arange(9.0)]}, path, _use_new_zipfile_serialization=False)
    data = path.read_bytes()
    for length in range(0, len(data), 5):
        path.write_bytes(data[:length])
        with pytest.raises(GdgError, match=r"a.pt: is refused"):
            read_tensor_file(path)
