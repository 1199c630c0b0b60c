"""How different the passing grasps of a row are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.evaluation.tasks import PALM
from gdg.metrics import coverage, distinct_grasps, joint_diversity


@dataclass(frozen=True)
class Spread:
    """Diversity of passing grasps; seeds are pooled in all of it.

    Attributes:
        joints_rad: mean over objects of the standard deviation of joint values (the mean over
            joints); objects with fewer than two passing grasps are left out. What GenDexGrasp's
            tables have: only by object can its UniGrasp top-1, one grasp per object, have 0.000.
        joints_pooled_rad: the same over the passing grasps of all objects at once.
        objects: how many objects ``joints_rad`` is the mean of.
        coverage: mean over objects of the share of directions from which passing grasps come.
        distinct: passing grasps that differ by more than 1 cm or 15 degrees, over all objects.
    """

    joints_rad: float
    joints_pooled_rad: float
    objects: int
    coverage: float
    distinct: int


def spread_of(by_object: Sequence[Sequence[tuple[RunConfig, GraspSet]]]) -> Spread:
    """The spread of a row.

    Args:
        by_object: the cells of each object.
    """
    sets = [pooled([grasps for _, grasps in cells]) for cells in by_object]
    found = [grasps for grasps in sets if grasps is not None]
    deviations = [d for grasps in found if math.isfinite(d := diversity(grasps))]
    return Spread(
        joints_rad=sum(deviations) / len(deviations) if deviations else math.nan,
        joints_pooled_rad=diversity(pooled(found)),
        objects=len(deviations),
        coverage=sum(map(_coverage, found)) / len(by_object),
        distinct=sum(map(distinct_grasps, found)),
    )


def diversity(grasps: GraspSet | None) -> float:
    """``joint_diversity``, NaN where there is no grasp."""
    return math.nan if grasps is None else joint_diversity(grasps)


def pooled(sets: Sequence[GraspSet]) -> GraspSet | None:
    """Poses, joints, verdicts and palm directions of sets of one hand; None of no grasp."""
    tested = [grasps for grasps in sets if grasps.verdicts]
    if not tested:
        return None
    first = tested[0]
    palms = all(name in grasps.metrics for grasps in tested for name in PALM)
    return GraspSet(
        first.hand,
        first.object_name,
        first.joint_names,
        first.root_link,
        torch.cat([grasps.poses for grasps in tested]),
        torch.cat([grasps.joints for grasps in tested]),
        verdicts=tuple(itertools.chain.from_iterable(grasps.verdicts for grasps in tested)),
        metrics={
            name: torch.cat([grasps.metrics[name] for grasps in tested])
            for name in (PALM if palms else ())
        },
    )


def _coverage(grasps: GraspSet) -> float:
    if not all(name in grasps.metrics for name in PALM):
        return math.nan
    palms = torch.stack([grasps.metrics[name] for name in PALM], dim=-1)
    return coverage(palms[grasps.passed])
