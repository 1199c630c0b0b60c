"""Disk cache by content hash: arrays that are expensive to compute and cheap to store."""

from __future__ import annotations

import hashlib
import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import platformdirs

from gdg.data.atomic import atomic_path
from gdg.errors import GdgError

#: What numpy and zipfile raise on a file that was cut off or damaged.
UNREADABLE = (
    EOFError, LookupError, MemoryError, OSError, RuntimeError, TypeError, ValueError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
Arrays = Mapping[str, np.ndarray]


def cache_directory() -> Path:
    """``GDG_CACHE`` if set, else the user's cache directory."""
    given = os.environ.get("GDG_CACHE")
    return Path(os.path.expanduser(given) if given else platformdirs.user_cache_dir("gdg"))


def content_hash(*parts: bytes | str | float | int) -> str:
    """SHA-256 of the parts, in order, as 64 hex digits; strings and numbers by their ``repr``."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def cached_arrays(kind: str, key: str, compute: Callable[[], Arrays]) -> Arrays:
    """Arrays stored under ``kind/key``, computed and stored on the first call.

    A file that can't be read (cut off by a crash of an older version) is computed anew. Files are
    written atomically, so processes may share the cache.

    Raises:
        GdgError: the cache can't be written.
    """
    path = cache_directory() / kind / f"{key}.npz"
    if path.is_file():
        try:
            with np.load(path, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files}
        except UNREADABLE:
            path.unlink(missing_ok=True)
    arrays = compute()
    try:
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
    except OSError as error:
        raise GdgError(
            f"{path}: the cache cannot be written: {error.strerror or error}. Set GDG_CACHE to a "
            f"folder with space that you may write to."
        ) from error
    return arrays
