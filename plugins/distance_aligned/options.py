"""Options of the aligned distance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gdg.components import Options


class AlignedOptions(Options):
    """Options of ``AlignedDistance``.

    Attributes:
        preset: ``release`` scales the distance by 10 before the sigmoid and sharpens softly, as
            the released code does and the released weights expect; ``paper`` follows Eq. 4.
        gamma: weight γ of the alignment; 0 gives √‖·‖. The search is exact up to 4.
    """

    preset: Literal["release", "paper"] = "release"
    gamma: Annotated[float, Field(ge=0, le=4)] = 1.0
