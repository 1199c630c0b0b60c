"""Planner: contact points chosen stage by stage, then inverse kinematics (Shao et al. 2020)."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import UniGraspOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="planner",
            name="unigrasp",
            target="gdg_plugins.planner_unigrasp.planner:UniGraspPlanner",
            summary="contact points by a network, fingers by inverse kinematics (UniGrasp)",
            options=UniGraspOptions,
            requires=("safetensors",),
        )
    ]
