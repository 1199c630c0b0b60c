"""Options of this package's components. Light: imports no torch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gdg.components import Options

Positive = Annotated[float, Field(gt=0)]
Weight = Annotated[float, Field(ge=0)]


class HuberOptions(Options):
    """Options of ``HuberDistance``.

    Attributes:
        knee: the distance is quadratic below this and linear above, metres.
        reach: the contact value falls to 1/e at this distance, metres.
        gamma: weight of the alignment; 0 takes both sides of the surface alike.
    """

    knee: Positive = 0.001
    reach: Positive = 0.01
    gamma: Annotated[float, Field(ge=0, le=4)] = 1.0


class EvolutionOptions(Options):
    """Options of ``EvolutionFitter``.

    Attributes:
        population: hands per contact map; at least four, since each learns from three others.
        generations: rounds of trials at most.
        tolerance: a map is done when half of its population lies this close to its best energy.
        every: trials are judged at every so-manieth object point, the result at all of them.
        greed: the share of best hands that the others are drawn to.
        crossover: the chance of each entry of q to be changed by a trial.
        sharpen: sharpen the target map, as the distance says.
        start: ``sphere``: on the object's enclosing sphere; ``surface``: above its convex hull.
        penetration_weight: per metre of summed depth.
        self_weight: per metre of self-penetration.
    """

    population: Annotated[int, Field(ge=4, le=4096)] = 48
    generations: Annotated[int, Field(ge=1)] = 100
    tolerance: Weight = 1e-4
    every: Annotated[int, Field(ge=1)] = 4
    greed: Annotated[float, Field(gt=0, le=1)] = 0.2
    crossover: Annotated[float, Field(gt=0, le=1)] = 0.9
    sharpen: bool = True
    start: Literal["sphere", "surface"] = "sphere"
    penetration_weight: Weight = 3.0
    self_weight: Weight = 1.0
