"""Fitter of the paper: many particles, plain Adam."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import AdamOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="fitter",
            name="adam",
            target="gdg_plugins.fitter_adam.fitter:AdamFitter",
            summary="GenDexGrasp's fit: 32 particles of Adam on contact, penetration and limits",
            options=AdamOptions,
            uses=("distance",),
        )
    ]
