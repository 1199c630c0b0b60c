"""Options that every fitter by gradient has. Light: imports no numerical library."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gdg.components import Options

Weight = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1, le=4096)]
Steps = Annotated[int, Field(ge=1)]
Rate = Annotated[float, Field(gt=0)]


class FitOptions(Options):
    """Options of ``ParticleFitter``.

    Attributes:
        particles: starts per contact map.
        search_every: nearest hand points are searched anew in every so-manieth step, and kept in
            between; 1 is the paper's fit, exact in every step.
        sharpen: sharpen the target map, as the distance's preset says.
        start: ``sphere``: uniform rotations on the enclosing sphere (paper); ``surface``: palm
            above the object's convex hull.
        start_factor: enclosing radius × this is where the palm starts (``sphere``).
        extra_weight: what contact beyond the map's weighs against contact that is missing: 0 lets
            the hand touch more than the map asks for; the paper's 1 treats both alike.
        penetration: ``sdf``: Σ relu(−δ) (paper); ``nearest``: 100 × the release's nearest-point
            mean.
        penetration_weight: per metre of summed depth.
        penetration_ramp: the weight grows geometrically by this factor over the fit, so that the
            hand finds the contacts first and ends outside the object.
        limit_weight: weight of the joint-limit norm E_n.
        self_weight: weight of self-penetration, per metre; 0 leaves it out.
        max_memory_mb: how much a fit may hold at once, beside what the libraries take; more maps
            are fitted in groups, with the same result.
        keep: how many particles of each map are returned, the lowest energies first, at most all; a
            planner chooses among them. The paper keeps one.
    """

    particles: Count = 32
    search_every: Steps = 3
    sharpen: bool = True
    start: Literal["sphere", "surface"] = "sphere"
    start_factor: Rate = 1.0
    extra_weight: Weight = 0.0
    penetration: Literal["sdf", "nearest"] = "sdf"
    penetration_weight: Weight = 0.1
    penetration_ramp: Annotated[float, Field(ge=1)] = 30.0
    limit_weight: Weight = 1.0
    self_weight: Weight = 1.0
    max_memory_mb: Annotated[float, Field(gt=0)] = 250.0
    keep: Count = 8
