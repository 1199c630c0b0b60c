"""Options of the flow generator."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from gdg.components import Options


class FlowOptions(Options):
    """Options of ``FlowGenerator``.

    Attributes:
        weights: name of bundled weights (``full``: no hand held out), or the path of a
            ``.safetensors`` file that ``gdg train`` wrote.
        steps: integration steps from noise to a map, each one pass of the network; more give
            maps closer to what it learned.
        temperature: standard deviation of the noise that a map starts from; the network is
            trained for 1, and less gives more typical maps.
        batch: maps integrated at a time, which bounds memory (about 2 MB per map).
        width: channels of a patch in a network to be trained; weights know their own.
        layers: transformer layers, likewise.
        heads: attention heads, likewise; must divide ``width``.
        draws: noises and times per map and training step; the map's object is looked at once.
    """

    weights: Annotated[str, Field(min_length=1)] = "full"
    steps: Annotated[int, Field(ge=1, le=1000)] = 16
    temperature: Annotated[float, Field(ge=0.0, le=3.0)] = 1.0
    batch: Annotated[int, Field(ge=1, le=4096)] = 32
    width: Annotated[int, Field(ge=16, le=512)] = 128
    layers: Annotated[int, Field(ge=1, le=24)] = 4
    heads: Annotated[int, Field(ge=1, le=16)] = 4
    draws: Annotated[int, Field(ge=1, le=64)] = 3

    @model_validator(mode="after")
    def _heads_divide_width(self) -> FlowOptions:
        if self.width % self.heads:
            raise ValueError(f"heads={self.heads} doesn't divide width={self.width}")
        return self
