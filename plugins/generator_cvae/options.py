"""Options of the CVAE generator."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.components import Options


class CvaeOptions(Options):
    """Options of ``CvaeGenerator``.

    Attributes:
        weights: name of bundled weights (the cards in ``weights/`` say which hands and objects
            each has seen), or the path of a ``.safetensors`` file that ``gdg train`` wrote or of a
            ``.pth`` file that the method's authors released.
        temperature: standard deviation of the latent; the network is trained for 1, and less
            gives maps nearer to the average one.
        batch: maps decoded at a time, which bounds memory (about 10 MB per map).
    """

    weights: Annotated[str, Field(min_length=1)] = "full"
    temperature: Annotated[float, Field(ge=0.0, le=3.0)] = 1.0
    batch: Annotated[int, Field(ge=1, le=4096)] = 16
