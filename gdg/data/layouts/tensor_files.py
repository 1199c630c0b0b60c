"""Reads ``.pt`` files that hold nothing but tensors and plain values."""

from __future__ import annotations

import pickle
import struct
import warnings
import zipfile
from pathlib import Path
from typing import Any

import torch

from gdg.errors import GdgError

#: The largest published file (436 000 contact maps of 2048 values) has 3.6 GB.
MAX_BYTES = 16 * 10**9
UNREADABLE = (
    pickle.UnpicklingError, RuntimeError, EOFError, OSError, ValueError, TypeError, KeyError,
    IndexError, AttributeError, AssertionError, zipfile.BadZipFile, ImportError, MemoryError,
    struct.error, RecursionError, OverflowError,
)  # fmt: skip


def read_tensor_file(path: Path) -> Any:
    """What ``torch.save`` wrote, tensors on the processor; never runs code (``weights_only``).

    Raises:
        GdgError: the file can't be read, is too large or compressed, or holds anything but
            tensors and plain values.
    """
    try:
        zipped = _check_size(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on pickle protocols; what matters is an error
            return torch.load(path, map_location="cpu", weights_only=True, mmap=zipped)
    except UNREADABLE as error:
        raise GdgError(
            f"{path}: is refused: gdg reads only tensors and plain values from such files, never "
            f"code, and this one {_reason(error)}."
        ) from error


def _check_size(path: Path) -> bool:
    """Whether the file is an archive of today's kind, whose tensors need not be read at once."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES // 10**9} GB")
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > 2 * size:
            raise ValueError("is compressed, which torch.save never does")
    return True


def _reason(error: BaseException) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, pickle.UnpicklingError):
        name = text.partition("GLOBAL ")[2].split(" ")[0]
        return f"names '{name}'" if name else "holds something else"
    if text.startswith("is "):
        return text
    return f"can't be read ({text[:160] or type(error).__name__})"
