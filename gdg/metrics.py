"""Numbers that sum up a set of grasps: success with its interval, diversity, penetration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gdg.data.grasps import GraspSet

#: Two-sided 95 % quantile of the normal distribution.
Z_95 = 1.959963984540054


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
