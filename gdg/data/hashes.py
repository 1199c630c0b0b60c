"""Hashes of grasps: which one is which, and whether any bit of a table has changed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from torch import Tensor

#: Bytes of a grasp's id: among 10^10 grasps two get the same with a probability of 10^-19.
ID_BYTES = 16


def grasp_ids(
    hand_hash: str,
    object_hash: str,
    poses: Float[Tensor, "grasp 4 4"],
    joints: Float[Tensor, "grasp joint"],
) -> list[str]:
    """An id per grasp, 32 hex digits, of hand, object, pose and joint values in single precision.

    The same grasp has the same id in every shard and dataset; its energies, its verdict and the
    names of hand and object don't matter.
    """
    # + 0.0: a negative zero is the same number
    values = np.concatenate(
        (poses.float().cpu().flatten(1).numpy(), joints.float().cpu().numpy()), axis=1
    ).astype("<f4") + np.float32(0.0)
    start = hashlib.blake2b(f"{hand_hash}\n{object_hash}\n".encode(), digest_size=ID_BYTES)
    return [_finished(start, np.ascontiguousarray(row).tobytes()) for row in values]


def content_of(ids: Sequence[str], success: Sequence[bool]) -> str:
    """Hash of which grasps these are, in order, and which of them passed; 32 hex digits."""
    digest = hashlib.blake2b(digest_size=ID_BYTES)
    digest.update("".join(ids).encode())
    digest.update(bytes(success))
    return digest.hexdigest()


def checksum_of(header: bytes, table: pa.Table) -> str:
    """SHA-256 over a shard's header and its columns, as they are after reading them back."""
    digest = hashlib.sha256(header)
    for name in sorted(table.column_names):
        digest.update(name.encode())
        _add(digest, table[name].combine_chunks())
    return digest.hexdigest()


def _finished(start: Any, data: bytes) -> str:
    digest = start.copy()
    digest.update(data)
    return digest.hexdigest()


def _add(digest: Any, array: pa.Array) -> None:
    """Adds lengths, nulls and values, whatever the offsets and paddings of the buffers."""
    digest.update(len(array).to_bytes(8, "little"))
    if array.null_count:
        digest.update(np.packbits(array.is_null().to_numpy(zero_copy_only=False)).tobytes())
    if pa.types.is_list(array.type):
        _add_numbers(digest, array.value_lengths().fill_null(0))
        _add(digest, array.flatten())
    elif pa.types.is_string(array.type):
        _add_texts(digest, array.fill_null(""))
    elif array.null_count == len(array):
        return
    else:
        _add_numbers(digest, array.fill_null(0) if array.null_count else array)


def _add_numbers(digest: Any, array: pa.Array) -> None:
    digest.update(np.ascontiguousarray(array.to_numpy(zero_copy_only=False)).tobytes())


def _add_texts(digest: Any, array: pa.Array) -> None:
    """Adds the lengths of texts in bytes, then all their characters."""
    if not len(array):
        return
    _, offsets, data = array.buffers()
    ends = np.frombuffer(offsets, np.int32)[array.offset : array.offset + len(array) + 1]
    digest.update(np.diff(ends).tobytes())
    if data is not None:
        digest.update(memoryview(data)[ends[0] : ends[-1]])
