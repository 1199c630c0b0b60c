"""Aligned distance: a hand point in front of the surface is near, one behind it is far."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import AlignedOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="distance",
            name="aligned",
            target="gdg_plugins.distance_aligned.distance:AlignedDistance",
            summary="GenDexGrasp's aligned distance (Eq. 3), presets release and paper",
            options=AlignedOptions,
        )
    ]
