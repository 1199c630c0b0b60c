"""Numbers that sum up grasps: rates with intervals, diversity, overlap, agreement of judges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel

#: Two-sided 95 % quantile of the normal distribution.
Z_95 = 1.959963984540054
#: Cells in the rings into which directions are sorted, from +z to -z: 48 of 0.26 sr each.
RINGS = (1, 6, 11, 12, 11, 6, 1)
#: Grasps nearer than both are the same one, metres and radians (15°).
SAME_PLACE_M, SAME_ROTATION_RAD = 0.01, math.pi / 12


def wilson_interval(k: int | float, n: int, z: float = Z_95) -> tuple[float, float]:
    """Interval of a success rate of ``k`` out of ``n`` (Wilson 1927), as shares in [0, 1].

    Unlike the normal approximation it is sensible for few trials and for rates near 0 and 1.
    Without trials nothing is known: (0, 1).

    Args:
        k: successes; a broken number where each trial succeeded in part (the interval is then
            too wide, never too narrow, since such a trial varies less than a yes or no).
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


@dataclass(frozen=True)
class Rate:
    """So many successes in so many trials.

    Attributes:
        k: successes; NaN where they are not known.
        n: trials.
    """

    k: int | float
    n: int

    @property
    def share(self) -> float:
        """Successes per trial; NaN without trials."""
        return self.k / self.n if self.n else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % Wilson interval of the share; (0, 1) where nothing is known."""
        return (0.0, 1.0) if math.isnan(self.k) else wilson_interval(self.k, self.n)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as they stand in ``summary.json``."""
        return {"k": self.k, "n": self.n, "share": self.share, "interval": list(self.interval)}


def mean_interval(values: Sequence[float], least_error: float = 0.0) -> tuple[float, float]:
    """95 % interval of the mean of what the values are drawn from (Student's t).

    NaN at both ends for fewer than two values. For rates over objects it says how far another
    choice of objects would move the mean, which the Wilson interval does not.

    Args:
        values: independent of each other.
        least_error: standard error of the mean that is known from elsewhere; it counts where the
            values scatter less, by chance or because all are equal.
    """
    from scipy.stats import t as student  # takes half a second to import

    count = len(values)
    if count < 2:
        return math.nan, math.nan
    mean, error = float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(count)
    error = max(error, least_error)
    half = float(student.ppf(0.975, count - 1)) * error
    return mean - half, mean + half


def chance_error(rates: Sequence[Rate]) -> float:
    """Standard error of the mean share of some rates, if it is chance alone that trials differ by.

    Never 0: each rate is taken with a success and a failure more (Agresti & Caffo 2000).
    """
    more = [(rate.k + 1, rate.n + 2) for rate in rates]
    return math.sqrt(sum(k * (n - k) / n**3 for k, n in more)) / max(1, len(more))


def cohen_kappa(both: int, only_first: int, only_second: int, neither: int) -> float:
    """How far two judges' yes and no agree beyond chance (Cohen 1960): 1 wholly, 0 by chance.

    NaN where chance alone makes them agree: no cases, or all of both judges alike.
    """
    n = both + only_first + only_second + neither
    if n == 0:
        return math.nan
    yes_1, yes_2 = (both + only_first) / n, (both + only_second) / n
    chance = yes_1 * yes_2 + (1 - yes_1) * (1 - yes_2)
    return math.nan if chance == 1 else ((both + neither) / n - chance) / (1 - chance)


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


def palm_directions(hand: HandModel, grasps: GraspSet) -> Float[Tensor, "grasp 3"]:
    """Where the palm of each grasp looks: its outward unit normal in the object's frame."""
    if not len(grasps):
        return torch.zeros(0, 3)
    return hand.palm(hand.q_of(grasps))[1].detach().cpu()


def direction_coverage(hand: HandModel, grasps: GraspSet) -> float:
    """``coverage`` of the sides from which the passing grasps come."""
    return coverage(palm_directions(hand, grasps.select(grasps.passed)))


def coverage(directions: Float[Tensor, "grasp 3"]) -> float:
    """From how many sides grasps come: share of occupied cells of the sphere, 0 to 1.

    The sphere of directions is cut into 48 cells of equal area and similar width: two caps about
    the object's z axis and rings between them (``RINGS``; as in Leopardi 2006). n directions that
    are spread evenly at random occupy 1 − (1 − 1/48)ⁿ of them: 0.74 for n = 64.

    Args:
        directions: unit vectors in the object's frame.
    """
    if len(directions) == 0:
        return 0.0
    x, y, z = directions.numpy().astype(np.float64).T
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
