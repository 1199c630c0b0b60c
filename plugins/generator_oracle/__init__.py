"""Contact-map generator that hands out the maps of known grasps."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import OracleOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="generator",
            name="oracle",
            target="gdg_plugins.generator_oracle.generator:OracleGenerator",
            summary="contact maps of the grasps in a file: what a perfect generator would give",
            options=OracleOptions,
            uses=("distance",),
        )
    ]
