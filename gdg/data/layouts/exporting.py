"""Which grasps of a dataset are exported, with the hands that they are of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from torch import Tensor

from gdg.contact_maps import contact_map_of
from gdg.data.dataset import ShardInfo, read_shard, shards
from gdg.data.grasps import GraspSet
from gdg.data.layouts.foreign import PairToExport
from gdg.data.layouts.lookup import Lookup
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.hands.hand import Hand
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel

#: Why grasps of an object on a table are refused where only the object itself can be told.
ON_TABLE = (
    "the dataset has grasps of objects on a table, for which this layout has no place; write "
    "--layout compact."
)


def chosen_shards(root: Path, only_hands: Sequence[str] = ()) -> list[ShardInfo]:
    """The shards of a dataset that hold grasps, of the chosen hands (none: of all).

    Raises:
        GdgError: the dataset holds no such hand, or no grasp.
    """
    found = [info for info in shards(root) if info.count]
    hands = {info.hand for info in found}
    for name in only_hands:
        if name not in hands:
            raise GdgError(f"{root}: holds no grasps of '{name}'.{did_you_mean(name, hands)}")
    chosen = [info for info in found if not only_hands or info.hand in only_hands]
    if not chosen:
        raise GdgError(f"{root}: holds no grasps.")
    return chosen


def valid_grasps(info: ShardInfo, failed_too: bool = False) -> GraspSet:
    """The grasps of a shard that passed their test, or all where none was tested."""
    grasps = read_shard(info.path)
    return grasps if failed_too or not grasps.verdicts else grasps.select(grasps.passed)


def pairs_to_export(
    chosen: Sequence[ShardInfo], lookup: Lookup, failed_too: bool = False
) -> list[PairToExport]:
    """The grasps of each shard with its hand, in the order of the shards.

    Raises:
        GdgError: every hand that can't be found, or that has other joints than the grasps; grasps
            of an object on a table.
    """
    pairs, mistakes = [], {}
    for info in chosen:
        try:
            hand = lookup.hand(info.hand, info.hand_path)
            _check_hand(info, hand)
        except GdgError as error:
            mistakes[str(error)] = None
            continue
        grasps = valid_grasps(info, failed_too)
        if grasps.scene is not None:
            mistakes[ON_TABLE] = None
        elif len(grasps):
            pairs.append(
                PairToExport(
                    hand,
                    grasps,
                    info.object_path or info.object_name,
                    info.object_scale,
                    info.object_hash,
                    info.split,
                )
            )
    raise_if_any(list(mistakes))
    if not pairs:
        raise GdgError("no grasp of the dataset passed its test; write --failed-too for the rest.")
    return pairs


def _check_hand(info: ShardInfo, hand: Hand) -> None:
    same_joints = sorted(info.joint_names) == sorted(hand.spec.joints)
    if not same_joints or info.root_link != hand.spec.root_link:
        raise GdgError(
            f"the grasps of '{info.hand}' have other joints or another root link than "
            f"{hand.folder}; give the hand that they were made with: --hand {info.hand}=FOLDER."
        )


#: Field of a grasp set -> what it is called when a layout drops it.
FIELDS = {
    "verdicts": "verdicts",
    "targets": "drive targets",
    "energies": "energies",
    "metrics": "metrics",
    "contacts": "contact points",
    "status": "the planner's status",
}


def dropped_fields(pairs: Sequence[PairToExport], kept: Sequence[str] = ()) -> str:
    """What the grasps have and a layout has no place for, in words; "" where that is nothing."""
    names = [
        word
        for field, word in FIELDS.items()
        if field not in kept and any(_has(pair.grasps, field) for pair in pairs)
    ]
    return ", ".join([*names, "provenance and hashes"])


def _has(grasps: GraspSet, field: str) -> bool:
    value = getattr(grasps, field)
    return value is not None and (field in ("targets", "contacts") or len(value) > 0)


def contact_maps_for(
    distance: Distance, model_of: Callable[[Hand], HandModel], lookup: Lookup
) -> Callable[[PairToExport], tuple[Tensor, Tensor]]:
    """A function that gives the contact maps of a pair and the points that they lie on.

    Raises:
        GdgError: (the function) the object is not the one that was grasped.
    """

    def maps(pair: PairToExport) -> tuple[Tensor, Tensor]:
        grasps = pair.grasps
        obj = lookup.object(grasps.object_name, pair.object_lookup, pair.object_scale)
        if obj.content_hash != pair.object_hash:
            raise GdgError(
                f"the grasps of '{grasps.object_name}' were made with another version of it than "
                f"{obj.path}; give the right one: --object {grasps.object_name}=FILE."
            )
        hand = model_of(pair.hand)
        columns = [grasps.joint_names.index(name) for name in hand.joint_names]
        q = hand.q_of(grasps, grasps.joints[:, columns])
        return contact_map_of(hand, obj, q, distance).values.cpu(), obj.points.cpu()

    return maps
