"""The flow from noise to contact maps: what is learned and how it is integrated.

Rectified flow (Liu et al. 2023), which is conditional flow matching with straight paths (Lipman et
al. 2023): at time t a map is x_t = (1 − t)·noise + t·map, and what is learned is the mean velocity
map − noise of all pairs that pass through x_t. Following it from noise at 0 to 1 gives maps of the
distribution that was learned from. The network predicts the map; the velocity follows from it as
(map − x_t) / (1 − t).

Flows run in contact values shifted and scaled to about mean 0 and deviation 1.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

#: Mean and deviation of contact values in training data: x = (C − MEAN) / SCALE.
MEAN, SCALE = 0.2, 0.2
#: Training times are logistic(N(TIME_MEAN, TIME_DEVIATION²)), median 0.18. Neighbouring points have
#: nearly the same value but noise of their own, so the network sees through much noise: by t = 0.1
#: it knows most of a map. Which grasp a map shows is decided before, so that is what most of the
#: times must teach; the deviation is wide, since the last times make contacts sharp.
TIME_MEAN, TIME_DEVIATION = -1.5, 1.6
#: The error of the velocity is that of the map over 1 − t, no less than this.
LEAST_REMAINING = 0.05
#: Integration times t = u / (u + (1 − u)·SHIFT) for evenly spaced u: small steps at first, for the
#: same reason.
SHIFT = 4.0

Maps = Float[Tensor, "*batch object_point"]
Times = Float[Tensor, "*batch"]


def standardised(values: Maps) -> Maps:
    """Contact values as the flow has them."""
    return (values - MEAN) / SCALE


def contact_values(maps: Maps) -> Maps:
    """The flow's maps as contact values, cut to [0, 1]."""
    return (maps * SCALE + MEAN).clamp(0, 1)


def draw_times(like: Times, generator: torch.Generator) -> Times:
    """Times to learn at, of the shape and device of ``like``."""
    drawn = torch.randn(like.shape, generator=generator, device=generator.device)
    return torch.sigmoid(TIME_MEAN + TIME_DEVIATION * drawn).to(like)


def on_the_way(clean: Maps, noise: Maps, time: Times) -> Maps:
    """Where the straight path from noise to a clean map is at a time."""
    return torch.lerp(noise, clean, time[..., None])


def flow_loss(clean: Maps, predicted: Maps, time: Times) -> Times:
    """Mean squared error of each map's velocity, given the clean map that was predicted."""
    remaining = (1 - time).clamp(min=LEAST_REMAINING)
    return (predicted - clean).square().mean(-1) / remaining.square()


def integrate(predict: Callable[[Maps, float], Maps], noise: Maps, steps: int) -> Maps:
    """Follows the flow from noise to maps by Euler steps.

    Args:
        predict: the clean maps for noisy ones at a time in [0, 1).
        noise: where to start.
        steps: how many.
    """
    even = torch.linspace(0, 1, steps + 1, dtype=torch.float64)
    times = (even / (even + (1 - even) * SHIFT)).tolist()
    maps = noise
    for now, then in pairwise(times):
        # the last step ends in the prediction itself
        maps = torch.lerp(maps, predict(maps, now), (then - now) / (1 - now))
    return maps
