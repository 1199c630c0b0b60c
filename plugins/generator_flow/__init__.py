"""Contact-map generator: conditional flow matching with a transformer on surface patches."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import FlowOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="generator",
            name="flow",
            target="gdg_plugins.generator_flow.generator:FlowGenerator",
            summary="contact maps by flow matching with a patch transformer, trainable",
            options=FlowOptions,
            requires=("safetensors",),
        )
    ]
