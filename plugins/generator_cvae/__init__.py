"""Contact-map generator: a PointNet conditional variational auto-encoder."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import CvaeOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="generator",
            name="cvae",
            target="gdg_plugins.generator_cvae.generator:CvaeGenerator",
            summary="contact maps from a PointNet CVAE (Li et al. 2023), trainable",
            options=CvaeOptions,
            requires=("safetensors",),
        )
    ]
