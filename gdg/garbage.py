"""How often Python looks for garbage in cycles. Light."""

from __future__ import annotations

import gc

#: Container objects more than at the last look that make Python look again.
BETWEEN_LOOKS = 50_000


def look_rarely() -> None:
    """Leaves the many objects of imported libraries alone, for processes that are all gdg's.

    Python looks after every 700 new objects. Imports alone make very many that stay, each of which
    it looks through again and again, and little garbage lies in cycles.
    """
    gc.set_threshold(BETWEEN_LOOKS, *gc.get_threshold()[1:])
