"""Options of the contact-map planner. Light: imports no numerical library."""

from __future__ import annotations

from gdg.components import Options


class ContactMapOptions(Options):
    """What happens around generator and fitter.

    Attributes:
        close: flex fingers that the fit left off the object until they touch it.
    """

    close: bool = True
