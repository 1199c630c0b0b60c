"""Planner of the paper: generate contact maps, fit the hand to them."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import ContactMapOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="planner",
            name="contact-map",
            target="gdg_plugins.planner_contact_map.planner:ContactMapPlanner",
            options=ContactMapOptions,
            summary="contact maps from a generator, fitted by a fitter (GenDexGrasp)",
            uses=("generator", "fitter"),
        )
    ]
