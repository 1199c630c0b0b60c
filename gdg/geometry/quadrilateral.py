"""Points on a quadrilateral, as contact regions are."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def grid_on(corners: Float[np.ndarray, "4 3"], side: int) -> Float[np.ndarray, "point 3"]:
    """``side`` × ``side`` points of the bilinear surface between four corners that go round.

    Row by row: the first row runs from corner 0 to corner 1, the last from corner 3 to corner 2.
    """
    u, v = (t.ravel()[:, None] for t in np.meshgrid(*[np.linspace(0.0, 1.0, side)] * 2))
    near = (1 - u) * corners[0] + u * corners[1]
    far = (1 - u) * corners[3] + u * corners[2]
    return (1 - v) * near + v * far
