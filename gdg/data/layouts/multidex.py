"""MultiDex: one ``HAND/HAND.pt`` per hand, a list of (q, object, hand).

The dataset of GenDexGrasp (Li et al., ICRA 2023); see ``gdg.data.layouts.pose_vectors`` for q.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import torch

from gdg.data.atomic import atomic_path, write_text_atomically
from gdg.data.layouts import MULTIDEX_NAMES
from gdg.data.layouts.foreign import ForeignGrasps, PairToExport, file_name
from gdg.data.layouts.pose_vectors import (
    by_hand,
    grasps_of_rows,
    hand_info,
    vector_of_pair,
    vector_rows,
)
from gdg.data.layouts.tensor_files import read_tensor_file
from gdg.errors import GdgError


def read_multidex(path: Path, own_order: bool = False) -> list[ForeignGrasps]:
    """The grasps of a ``HAND.pt``, or of every one in a folder.

    Args:
        path: a file, or the folder that holds ``HAND/HAND.pt`` or ``HAND.pt``.
        own_order: see ``grasps_of_rows``.

    Raises:
        GdgError: no such file, or one that isn't of this layout.
    """
    files = [path]
    if path.is_dir():
        files = sorted({*path.glob("*.pt"), *path.glob("*/*.pt")})
        if not files:
            raise GdgError(f"{path}: holds no HAND/HAND.pt.")
    return [grasps for file in files for grasps in _read_file(file, own_order)]


def _read_file(path: Path, own_order: bool) -> list[ForeignGrasps]:
    tree = read_tensor_file(path)
    if not isinstance(tree, dict) or "metadata" not in tree:
        raise GdgError(f"{path}: is no MultiDex file: it has no 'metadata'.")
    rows = vector_rows(str(path), tree["metadata"], 0)
    info = tree.get("info")
    facts = {row.hand: info for row in rows[:1]}
    return grasps_of_rows(str(path), rows, facts, own_order=own_order)


def write_multidex(pairs: Sequence[PairToExport], out: Path) -> list[Path]:
    """Writes one file per hand and the list of names; returns what was written.

    Raises:
        GdgError: a hand's name can't be a file's name.
    """
    written = []
    for pair in pairs:
        file_name("hand", pair.grasps.hand)
    for hand, of_hand in by_hand(pairs).items():
        metadata = [
            (q, pair.grasps.object_name, hand) for pair in of_hand for q in vector_of_pair(pair)
        ]
        path = out / hand / f"{hand}.pt"
        with atomic_path(path) as temporary:
            torch.save({"info": hand_info(of_hand), "metadata": metadata}, temporary)
        written.append(path)
    names = {
        "robot_list": list(by_hand(pairs)),
        "object_list": list(dict.fromkeys(pair.grasps.object_name for pair in pairs)),
    }
    write_text_atomically(out / MULTIDEX_NAMES, json.dumps(names, indent=1) + "\n")
    return [*written, out / MULTIDEX_NAMES]
