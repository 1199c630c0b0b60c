"""Options of the halving fitter."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.fitting.options import Count, FitOptions, Rate, Steps

Points = Annotated[int, Field(ge=1)]


class HalvingOptions(FitOptions):
    """Options of ``HalvingFitter``, beside those of every fit.

    What a round has lies between what the first and the last have, each in equal ratios.

    Attributes:
        rounds: how often the worst particles are dropped, plus one.
        steps: Adam steps of all rounds together.
        particles: starts per contact map.
        finalists: particles per map in the last round; as many as ``keep`` if that is more, and
            never more than ``particles``.
        first_points: object points at which the first round compares the maps.
        last_points: object points of the last round.
        first_hand_stride: every so-manieth hand point is searched in the first round; every one in
            the last.
        learning_rate: of every entry of q (metres, rot6d, radians), in the first round.
        last_learning_rate: in the last round.
    """

    rounds: Annotated[int, Field(ge=2, le=20)] = 3
    steps: Steps = 100
    particles: Count = 64
    finalists: Count = 8
    first_points: Points = 64
    last_points: Points = 512
    first_hand_stride: Annotated[int, Field(ge=1, le=64)] = 8
    learning_rate: Rate = 1e-2
    last_learning_rate: Rate = 5e-3
