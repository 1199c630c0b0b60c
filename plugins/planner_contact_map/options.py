"""Options of the contact-map planner. Light: imports no numerical library."""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gdg.components import Options


class ContactMapOptions(Options):
    """What happens around generator and fitter.

    Verified grasps, which a test chooses among, have one map each.

    Attributes:
        maps: contact maps generated per grasp asked for; the grasps of the best are kept. The
            paper makes one. Below 1, several fits to a map are kept, which takes spread, and at
            least 1/maps fits to each (fitter.keep).
        close: flex fingers that the fit left off the object until they touch it.
        rank: the energy by which one of the fits to each map is kept and grasps are sorted.
            ``energy``: the fit's (paper); only what is kept is closed then; ``stability``: the
            margin of force closure and the overlap by exact shapes, after closing.
        spread: when ranking by ``stability``: how much margin a grasp may lack per radian (root
            mean square over the joints) by which it differs from those chosen before; 0 keeps the
            best fit of each of the best maps.
        max_overlap_mm: overlap of hand and object, of the hand's links or of hand and table that
            costs nothing when ranking by ``stability``.
    """

    for_verified = MappingProxyType({"maps": 1.0})
    maps: Annotated[float, Field(gt=0, le=100)] = 4.0
    close: bool = True
    rank: Literal["energy", "stability"] = "stability"
    spread: Annotated[float, Field(ge=0, le=100)] = 0.5
    max_overlap_mm: Annotated[float, Field(ge=0)] = 1.5

    @model_validator(mode="after")
    def _enough_maps(self) -> ContactMapOptions:
        if self.maps < 1 and (self.rank == "energy" or not self.spread):
            raise ValueError("maps below 1 need rank=stability and spread > 0")
        return self
