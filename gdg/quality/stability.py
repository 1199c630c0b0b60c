"""How stable a planned grasp promises to be, before any simulation."""

from __future__ import annotations

from dataclasses import replace

import torch

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality import exact_overlap, find_contacts, force_closure_margins

#: What a millimetre of overlap beyond the allowed one weighs against the margin.
OVERLAP_WEIGHT = 0.5
#: The margin's place in the energy of a hand that touches nothing: worse than any other.
NO_CONTACT = 2.0


def judged_by_stability(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, max_overlap_mm: float
) -> GraspSet:
    """The grasps with ``total`` energies by stability; ``planned`` are the old.

    The total is the grasp's margin of force closure (``force_closure_margin``), with its sign
    turned, plus a penalty for overlap by exact shapes. An object in unbalanced contacts moves while
    the hand closes, which is what most fits to contact maps fail by; one in an overlapping hand is
    thrown out.

    Args:
        hand: the hand.
        obj: the object.
        grasps: of that hand on that object, with a ``total`` energy.
        max_overlap_mm: overlap that costs nothing: of hand and object, of the hand's links, and of
            hand and table.
    """
    overlap = exact_overlap(hand, obj, grasps)
    margin = force_closure_margins(obj, find_contacts(hand, obj, grasps))
    deepest = torch.stack((overlap.object_mm, overlap.self_mm, overlap.table_mm)).amax(0)
    excess = (deepest - max_overlap_mm).clamp(min=0).nan_to_num(nan=torch.inf)
    energies = {
        "total": OVERLAP_WEIGHT * excess - margin.nan_to_num(nan=-NO_CONTACT),
        "planned": grasps.energies["total"],
        **{name: values for name, values in grasps.energies.items() if name != "total"},
    }
    return replace(grasps, energies=energies)
