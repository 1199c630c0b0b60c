"""Foreign grasps into a dataset: hands and objects found, joints named, shards written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

import gdg
from gdg.cache import content_hash
from gdg.data.dataset import shard_path, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.layouts.chain import COUPLING_TOLERANCE, actuated_values
from gdg.data.layouts.foreign import ForeignGrasps
from gdg.data.layouts.lookup import Lookup
from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.identity import object_hash
from gdg.objects.model import ObjectModel
from gdg.splits.catalogue import TEST, is_test_object

#: A joint value this far beyond its limits is told, rad or m.
LIMIT_TOLERANCE = 1e-3


@dataclass
class ImportReport:
    """What became of an import.

    Attributes:
        pairs: hand-object pairs written, or found already there.
        grasps: how many they hold.
        notes: what the user should know, one sentence each.
        skipped: why a pair was left out, one sentence each.
    """

    pairs: int = 0
    grasps: int = 0
    notes: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def import_grasps(
    layout: str,
    sets: Sequence[ForeignGrasps],
    lookup: Lookup,
    out: Path,
    tell: Callable[[int, int], None] | None = None,
) -> ImportReport:
    """Writes one shard per hand-object pair; a pair that can't be imported is told, not fatal.

    The same import again replaces its own shards, and adds nothing.

    Args:
        layout: for the provenance.
        sets: what the layout's reader gave.
        lookup: finds hands and objects.
        out: the dataset's folder.
        tell: called with (pairs done, pairs in all).
    """
    report = ImportReport()
    notes: dict[str, None] = {}
    skipped: dict[str, None] = {}
    # by object, so that each is loaded once
    for done, read in enumerate(sorted(sets, key=lambda s: (s.object_name, s.object_scale)), 1):
        try:
            count = _import_pair(layout, read, lookup, out, notes)
            report.pairs, report.grasps = report.pairs + 1, report.grasps + count
        except GdgError as error:
            skipped.update(dict.fromkeys(str(error).splitlines()))
        if tell is not None:
            tell(done, len(sets))
    report.notes, report.skipped = list(notes), list(skipped)
    return report


def _import_pair(
    layout: str, read: ForeignGrasps, lookup: Lookup, out: Path, notes: dict[str, None]
) -> int:
    hand = lookup.hand(read.hand)
    if read.root_link and read.root_link != hand.spec.root_link:
        raise GdgError(
            f"{read.source}: gives poses of the link '{read.root_link}', but the root link of "
            f"{hand.folder} is '{hand.spec.root_link}', so it is not the hand that the file was "
            f"made with; give that one: --hand {read.hand}=FOLDER."
        )
    values, strays = actuated_values(hand, read)
    obj = lookup.object(read.object_name, read.object_lookup, read.object_scale)
    grasps = _grasp_set(read, hand, values, notes)
    notes.update(dict.fromkeys(_assumptions(read, hand, strays)))
    key = content_hash(
        "layout-1", layout, read.poses.tobytes(), values.tobytes(),
        hand.content_hash, obj.content_hash,
    )[:16]  # fmt: skip
    if not shard_path(out, grasps.hand, grasps.object_name, key).is_file():
        write_shard(
            out,
            key,
            grasps,
            {
                "hand_hash": hand.content_hash,
                "object_hash": obj.content_hash,
                "split": _split(read, obj, lookup),
                "hand_path": lookup.hand_place(read.hand),
                "object_path": lookup.object_place(read.object_name, read.object_lookup),
                "object_scale": read.object_scale,
                "gdg": gdg.__version__,
                "imported": {"layout": layout, "file": Path(read.source).name},
            },
        )
    return len(grasps)


def _split(read: ForeignGrasps, obj: ObjectModel, lookup: Lookup) -> str:
    """``test`` where file, object or catalogue say so: by name, or by content at any scale."""
    if TEST in (obj.split, read.split) or is_test_object(read.object_name, obj.content_hash):
        return TEST
    if read.object_scale != 1.0:
        word = lookup.object_word(read.object_name, read.object_lookup)
        if is_test_object(read.object_lookup or read.object_name, object_hash(word)):
            return TEST
    return obj.split or read.split


def _assumptions(read: ForeignGrasps, hand: Hand, strays: float) -> Iterator[str]:
    """What was taken for granted or lost, in a sentence each."""
    whose = f"of '{read.hand}' " if read.hand else ""
    if not read.root_link:
        yield (
            f"the files do not name the link whose poses {whose}they give; they are taken for "
            f"poses of '{hand.spec.root_link}', the root link of {hand.folder}."
        )
    if read.joint_names is None:
        yield (
            f"the joints {whose}have no names in the files; they are taken in the order of the "
            f"chain of {hand.folder}."
        )
    if strays > COUPLING_TOLERANCE:
        yield (
            f"{read.source}: joints {whose}that mimic others do not follow them on "
            f"'{read.object_name}'; gdg keeps the actuated joints only (the others move by up to "
            f"{strays:.3f} rad or m)."
        )


def _grasp_set(
    read: ForeignGrasps, hand: Hand, values: np.ndarray, notes: dict[str, None]
) -> GraspSet:
    fine = np.asarray(np.isfinite(read.poses).all(axis=(1, 2)) & np.isfinite(values).all(axis=1))
    if not fine.all():
        notes[
            f"{read.source}: {int((~fine).sum())} of {len(fine)} grasps of '{read.object_name}' "
            f"have values that are not finite, or no rotation, and were left out."
        ] = None
    if not fine.any():
        raise GdgError(f"{read.source}: '{read.object_name}': no grasp has finite values.")
    lower, upper = hand.limits()
    excess = np.maximum(lower - values[fine], values[fine] - upper).max(axis=1)
    beyond = np.asarray(excess > LIMIT_TOLERANCE)
    if beyond.any():
        notes[
            f"{read.source}: {int(beyond.sum())} of {len(fine)} grasps of '{read.object_name}' "
            f"have joints beyond their limits; they are kept as they are."
        ] = None
    return GraspSet(
        hand=hand.name,
        object_name=read.object_name,
        joint_names=hand.spec.joints,
        root_link=hand.spec.root_link,
        poses=torch.from_numpy(read.poses[fine].astype(np.float32)),
        joints=torch.from_numpy(values[fine].astype(np.float32)),
        energies={
            name: torch.from_numpy(column[fine].astype(np.float32))
            for name, column in read.energies.items()
        },
    )
