"""What every grasp set must fulfil, whoever planned it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import torch

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.testing.checks import differ, not_rigid

STATUSES = ("converged", "diverged", "hit_limit")
#: Joint values may exceed their limits by rounding alone, rad or m.
LIMIT_TOLERANCE = 1e-5
#: Two runs from the same seed; only the order of parallel sums may differ.
REPEAT_TOLERANCE = 1e-4


def grasp_set_problems(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> Iterator[str]:
    """Names, shapes, limits, energies and status of grasps of one hand on one object."""
    yield from _wrong_names(hand, obj, grasps)
    count = len(grasps)
    if grasps.joints.shape != (count, len(hand.joint_names)):
        yield f"joints have the shape {tuple(grasps.joints.shape)}."
        return
    if grasps.status and len(grasps.status) != count:
        yield f"{len(grasps.status)} statuses for {count} grasps."
        return
    for status in sorted(set(grasps.status) - set(STATUSES)):
        yield f"status '{status}' is none of {', '.join(STATUSES)}."
    if "total" not in grasps.energies:
        yield "energies must have 'total', what was minimised."
    yield from _wrong_types(grasps)
    for name, values in grasps.energies.items():
        if values.shape != (count,):
            yield f"energies['{name}'] has the shape {tuple(values.shape)}, not ({count},)."
    status = grasps.status or ("converged",) * count
    yield from _wrong_values(hand, grasps.select([i for i in range(count) if _good(status[i])]))


def _wrong_types(grasps: GraspSet) -> Iterator[str]:
    tensors = {"poses": grasps.poses, "joints": grasps.joints, "targets": grasps.targets}
    tensors["contact_values"] = grasps.contact_values
    tensors |= {f"energies['{name}']": values for name, values in grasps.energies.items()}
    for name, values in tensors.items():
        if values is not None and values.dtype != torch.float32:
            yield f"{name} must be float32, not {values.dtype}."


def _good(status: str) -> bool:
    return status != "diverged"


def _wrong_names(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> Iterator[str]:
    for what, given, wanted in (
        ("hand", grasps.hand, hand.hand.name),
        ("object_name", grasps.object_name, obj.name),
        ("root_link", grasps.root_link, hand.hand.spec.root_link),
        ("joint_names", grasps.joint_names, hand.joint_names),
    ):
        if given != wanted:
            yield f"{what} is {given!r}, not {wanted!r}."


def _wrong_values(hand: HandModel, grasps: GraspSet) -> Iterator[str]:
    if not bool(grasps.joints.isfinite().all()):
        yield "joints are not finite, and the status is not 'diverged'."
    for name, values in grasps.energies.items():
        if not bool(values.isfinite().all()):
            yield f"energies['{name}'] is not finite, and the status is not 'diverged'."
    if bool(not_rigid(grasps.poses).any()):
        yield "poses are not rigid, and the status is not 'diverged'."
    lower, upper = hand.lower.cpu() - LIMIT_TOLERANCE, hand.upper.cpu() + LIMIT_TOLERANCE
    outside = ((grasps.joints < lower) | (grasps.joints > upper)).any(0)
    for index in outside.nonzero()[:, 0].tolist():
        yield f"joint '{grasps.joint_names[index]}' is outside its limits."


def repeat_problems(first: GraspSet, second: GraspSet) -> Iterator[str]:
    """Two runs from the same generator state must give the same grasps."""
    same = len(first) == len(second) and not (
        differ(first.poses, second.poses, REPEAT_TOLERANCE)
        or differ(first.joints, second.joints, REPEAT_TOLERANCE)
    )
    if not same:
        yield "the same generator state gave other grasps: draw from the generator passed in."


def progress_problems(calls: list[tuple[int, int]]) -> Iterator[str]:
    """Progress counts up and never beyond its total."""
    if any(not 0 <= done <= total for done, total in calls):
        yield "progress was called with more steps done than there are."
    if any(later[0] < sooner[0] for sooner, later in pairwise(calls)):
        yield "progress went backward."
