"""Planner: a hand-aware CVAE that regresses grasps (Jiang et al. 2021)."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import GraspCvaeOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="planner",
            name="graspcvae",
            target="gdg_plugins.planner_graspcvae.planner:GraspCvaePlanner",
            summary="poses from a CVAE of one hand, adapted at test time (Jiang et al. 2021)",
            options=GraspCvaeOptions,
            uses=("distance",),
            requires=("safetensors",),
        )
    ]
