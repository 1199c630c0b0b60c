"""How stable a planned grasp promises to be, before any simulation."""

from __future__ import annotations

from dataclasses import replace

import torch

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality import measure

#: Metrics that count as overlap, millimetres.
OVERLAPS = ("penetration_mm", "self_penetration_mm", "table_penetration_mm")
#: What a millimetre of overlap beyond the allowed one weighs against the margin.
OVERLAP_WEIGHT = 0.5
#: The margin's place in the energy of a hand that touches nothing: worse than any other.
NO_CONTACT = 2.0


def judged_by_stability(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, max_overlap_mm: float
) -> GraspSet:
    """The grasps with ``metrics`` and ``total`` energies by stability; ``planned`` are the old.

    The total is the grasp's margin of force closure, with its sign turned, plus a penalty for
    overlap by exact shapes. The margin is how far zero lies inside the grasp's wrench space
    (``epsilon``), or, negative, outside of it (``wrench_residual``). An object in unbalanced
    contacts moves while the hand closes, which is what most fits to contact maps fail by; one in an
    overlapping hand is thrown out.

    Args:
        hand: the hand.
        obj: the object.
        grasps: of that hand on that object, with a ``total`` energy.
        max_overlap_mm: overlap that costs nothing: of hand and object, of the hand's links, and of
            hand and table.
    """
    measured = measure(hand, obj, grasps)
    m = measured.metrics
    margin = m["epsilon"] - m["wrench_residual"].nan_to_num(nan=NO_CONTACT)
    overlap = torch.stack([m[name] for name in OVERLAPS if name in m]).amax(0)
    excess = (overlap - max_overlap_mm).clamp(min=0).nan_to_num(nan=torch.inf)
    energies = {
        "total": OVERLAP_WEIGHT * excess - margin,
        "planned": grasps.energies["total"],
        **{name: values for name, values in grasps.energies.items() if name != "total"},
    }
    return replace(measured, energies=energies)
