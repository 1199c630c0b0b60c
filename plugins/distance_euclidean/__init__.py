"""Euclidean distance: the ablation of the aligned distance."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="distance",
            name="euclidean",
            target="gdg_plugins.distance_euclidean.distance:EuclideanDistance",
            summary="distance to the nearest hand point, blind to the side of the surface",
        )
    ]
