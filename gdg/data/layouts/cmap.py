"""CMapDataset: contact maps with the grasps that they are of, point clouds and a split.

The training data of GenDexGrasp (Li et al., ICRA 2023), and the files that D(R,O) made of it. The
release's validation objects are the test objects: here they become ``split: test``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from gdg.data.atomic import atomic_path, write_text_atomically
from gdg.data.layouts import CLOUDS_FILE, CMAP_FILE, SPLIT_FILE
from gdg.data.layouts.foreign import ForeignGrasps, PairToExport
from gdg.data.layouts.pose_vectors import (
    by_hand,
    grasps_of_rows,
    hand_info,
    vector_of_pair,
    vector_rows,
)
from gdg.data.layouts.tensor_files import read_tensor_file
from gdg.errors import GdgError

#: Part of the split file -> gdg's name.
SPLITS = {"train": "train", "validate": "test"}
MAX_SPLIT_BYTES = 10_000_000


def read_cmap(path: Path, own_order: bool = False) -> list[ForeignGrasps]:
    """The grasps of a CMapDataset; its maps and point clouds follow from them and are left.

    Args:
        path: the folder, or ``cmap_dataset.pt`` in it.
        own_order: see ``grasps_of_rows``.

    Raises:
        GdgError: a file is missing or isn't of this layout.
    """
    folder, file = (path, path / CMAP_FILE) if path.is_dir() else (path.parent, path)
    tree = read_tensor_file(file)
    if not isinstance(tree, dict) or not isinstance(tree.get("metadata"), list):
        raise GdgError(f"{file}: is no CMapDataset: it has no list 'metadata'.")
    metadata, info = tree["metadata"], tree.get("info")
    head = metadata[0] if metadata else ()
    first = 1 if isinstance(head, (tuple, list)) and len(head) == 4 else 0
    rows = vector_rows(str(file), metadata, first)
    facts = info if isinstance(info, Mapping) else {}
    read = grasps_of_rows(str(file), rows, facts, euler=first == 0, own_order=own_order)
    split = _read_split(folder / SPLIT_FILE)
    return [replace(grasps, split=split.get(grasps.object_name, "")) for grasps in read]


def _read_split(path: Path) -> dict[str, str]:
    """Object -> ``train`` or ``test``; empty where there is no split file."""
    if not path.is_file():
        return {}
    try:
        if path.stat().st_size > MAX_SPLIT_BYTES:
            raise ValueError("it is too large")
        tree = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): ours for theirs, ours in SPLITS.items() for name in tree.get(theirs, ())}
    except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
        raise GdgError(f"{path}: is no list of train and validate objects: {error}") from error


def write_cmap(
    pairs: Sequence[PairToExport],
    out: Path,
    map_of: Callable[[PairToExport], tuple[Tensor, Tensor]],
    label: str,
) -> list[Path]:
    """Writes the three files; returns them.

    Args:
        pairs: what to write.
        out: the folder.
        map_of: pair -> contact values (grasp, point) and the points (point, 3), metres.
        label: of the distance that the values are made with.
    """
    metadata, clouds, split = [], {}, {theirs: [] for theirs in SPLITS}
    for pair in pairs:
        name = pair.grasps.object_name
        values, clouds[name] = map_of(pair)
        for value, q in zip(values, vector_of_pair(pair), strict=True):
            metadata.append((value[:, None], q, name, pair.grasps.hand))
        part = "validate" if pair.split == "test" else "train"
        if name not in split[part]:
            split[part].append(name)
    info: dict[str, Any] = {hand: hand_info(own) for hand, own in by_hand(pairs).items()}
    tree = {"info": {"cmap_func": label, **info}, "metadata": metadata}
    for name, content in ((CMAP_FILE, tree), (CLOUDS_FILE, clouds)):
        with atomic_path(out / name) as temporary:
            torch.save(content, temporary)
    write_text_atomically(out / SPLIT_FILE, json.dumps(split, indent=1) + "\n")
    return [out / CMAP_FILE, out / CLOUDS_FILE, out / SPLIT_FILE]
