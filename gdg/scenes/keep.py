"""Leaves out the grasps that a table forbids."""

from __future__ import annotations

from dataclasses import replace

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration.table import hand_height
from gdg.scenes.above import ROUNDING_M, approach_height

#: Reasons, as they are counted in ``provenance["rejected"]``.
IN_TABLE, ON_THE_WAY = "hand in the table", "way to the grasp through the table"


def keep_above(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> GraspSet:
    """The grasps whose hand is above the table that the object rests on, and comes from above it.

    By the exact collision shapes (``gdg.penetration.table``, ``gdg.scenes.above``). Those left out
    are added to the counts in ``provenance["rejected"]``, by reason. Without a table all are kept.
    """
    if obj.table is None or not len(grasps):
        return grasps
    q = hand.q_of(grasps)
    # a height that is not finite compares as False, so it is rejected
    above = hand_height(hand, obj.table, q) >= -ROUNDING_M
    reached = above & (approach_height(hand, obj.table, q) >= -ROUNDING_M)
    rejected = dict(grasps.provenance.get("rejected", {}))
    for reason, failed in ((IN_TABLE, ~above), (ON_THE_WAY, above & ~reached)):
        rejected[reason] = rejected.get(reason, 0) + int(failed.sum())
    kept = grasps.select(reached.nonzero()[:, 0].tolist())
    return replace(kept, provenance={**grasps.provenance, "rejected": rejected})
