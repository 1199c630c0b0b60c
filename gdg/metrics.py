"""Numbers that sum up a set of grasps: success with its interval, diversity, overlap."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel

#: Two-sided 95 % quantile of the normal distribution.
Z_95 = 1.959963984540054
#: Cells in the rings into which directions are sorted, from +z to -z: 48 of 0.26 sr each.
RINGS = (1, 6, 11, 12, 11, 6, 1)
#: Grasps nearer than both are the same one, metres and radians (15°).
SAME_PLACE_M, SAME_ROTATION_RAD = 0.01, math.pi / 12


def wilson_interval(k: int, n: int, z: float = Z_95) -> tuple[float, float]:
    """Interval of a success rate of ``k`` out of ``n`` (Wilson 1927), as shares in [0, 1].

    Unlike the normal approximation it is sensible for few trials and for rates near 0 and 1.
    Without trials nothing is known: (0, 1).

    Args:
        k: successes.
        n: trials.
        z: quantile of the normal distribution; the default gives 95 %.

    Raises:
        ValueError: not 0 <= k <= n.
    """
    if not 0 <= k <= n:
        raise ValueError(f"successes must lie between 0 and {n} trials, not {k}")
    if n == 0:
        return 0.0, 1.0
    share, spread = k / n, z * z / n
    center = (share + spread / 2) / (1 + spread)
    half = z * math.sqrt(share * (1 - share) / n + spread / (4 * n)) / (1 + spread)
    # exact ends, which rounding would miss by 1e-17
    low = 0.0 if k == 0 else center - half
    high = 1.0 if k == n else center + half
    return low, high


def joint_diversity(grasps: GraspSet) -> float:
    """Mean over joints of the standard deviation of joint values over the passing grasps, rad.

    As in GenDexGrasp (Li et al. 2022), with n − 1 in the denominator; prismatic joints enter in
    metres. NaN when fewer than two grasps passed, for which it is not defined.
    """
    passed = grasps.passed
    if len(passed) < 2:
        return math.nan
    joints = grasps.joints[passed].detach().cpu().numpy().astype(np.float64)
    return float(joints.std(axis=0, ddof=1).mean())


def direction_coverage(hand: HandModel, grasps: GraspSet) -> float:
    """From how many sides the passing grasps come: share of occupied cells of the sphere, 0 to 1.

    The side is where the palm looks, its outward normal in the object's frame. The sphere of
    directions is cut into 48 cells of equal area and similar width: two caps about the object's z
    axis and rings between them (``RINGS``; as in Leopardi 2006). n directions that are spread
    evenly at random occupy 1 − (1 − 1/48)ⁿ of them: 0.74 for n = 64.
    """
    passed = grasps.select(grasps.passed)
    if len(passed) == 0:
        return 0.0
    x, y, z = hand.palm(hand.q_of(passed))[1].detach().cpu().numpy().astype(np.float64).T
    first_cell = np.cumsum((0, *RINGS))
    # equal heights have equal areas (Archimedes), so a ring's cells are its share of the height
    lower_ends = 1 - 2 * first_cell[1:-1] / first_cell[-1]
    ring = (z[:, None] <= lower_ends).sum(1)
    count = np.array(RINGS)[ring]
    sector = np.minimum((count * (np.arctan2(y, x) / (2 * np.pi) % 1.0)).astype(int), count - 1)
    return len(np.unique(first_cell[ring] + sector)) / int(first_cell[-1])


def distinct_grasps(
    grasps: GraspSet,
    place_m: float = SAME_PLACE_M,
    rotation_rad: float = SAME_ROTATION_RAD,
) -> int:
    """Number of passing grasps whose root poses differ by more than a distance or an angle.

    Greedy, in the order of the set: a grasp is counted unless one that was counted is near it, by
    at most ``place_m`` and ``rotation_rad`` at once. Joints play no part.
    """
    poses = grasps.poses[grasps.passed].detach().cpu().numpy().astype(np.float64)
    places, rotations = poses[:, :3, 3], poses[:, :3, :3].reshape(-1, 9)
    least_trace = 1 + 2 * math.cos(min(rotation_rad, math.pi))
    counted: list[int] = []
    for index in range(len(poses)):
        apart = ((places[counted] - places[index]) ** 2).sum(-1) > place_m**2
        # the trace of Rₐᵀ R_b is 1 + 2 cos(angle)
        if (apart | (rotations[counted] @ rotations[index] < least_trace)).all():
            counted.append(index)
    return len(counted)


@dataclass(frozen=True)
class PenetrationStats:
    """Overlap of hand and object before the test, over all simulated grasps, millimetres."""

    mean_mm: float
    median_mm: float
    p95_mm: float
    max_mm: float


def penetration_stats(grasps: GraspSet) -> PenetrationStats | None:
    """Statistics of ``Verdict.penetration_start_mm``, or None when nothing was simulated."""
    if not grasps.verdicts:
        return None
    depths = np.array([verdict.penetration_start_mm for verdict in grasps.verdicts])
    return PenetrationStats(
        mean_mm=float(depths.mean()),
        median_mm=float(np.median(depths)),
        p95_mm=float(np.quantile(depths, 0.95)),
        max_mm=float(depths.max()),
    )
