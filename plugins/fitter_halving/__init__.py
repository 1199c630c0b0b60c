"""Fitter that drops the worst particles early: successive halving, coarse to fine."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import HalvingOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="fitter",
            name="halving",
            target="gdg_plugins.fitter_halving.fitter:HalvingFitter",
            summary="many starts on few object points, ever fewer on more: better and faster",
            options=HalvingOptions,
            uses=("distance",),
        )
    ]
