"""Components of Acme for gdg. Read at every start of gdg, so nothing heavy is imported here."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import EvolutionOptions, HuberOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The records of this package's components; their classes are imported on first use."""
    return [
        Component(
            kind="distance",
            name="huber",
            target="gdg_acme.huber:HuberDistance",
            summary="aligned, in metres, flat within a millimetre of contact",
            options=HuberOptions,
        ),
        Component(
            kind="fitter",
            name="evolution",
            target="gdg_acme.evolution:EvolutionFitter",
            summary="differential evolution: no gradients, many starts that learn from each other",
            options=EvolutionOptions,
            uses=("distance",),
        ),
    ]
