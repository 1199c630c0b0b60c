"""Colours of pictures and reports: one scale of contact values, one colour per role."""

from __future__ import annotations

import numpy as np

#: Contact scale as sRGB at equal steps of the value: lightness (CIELAB L*) falls steadily from 88
#: to 23, so that it reads the same in grey and to colour-blind eyes; no contact is neutral grey.
CONTACT_SCALE = (
    (222, 221, 219),
    (244, 180, 100),
    (238, 130, 60),
    (212, 78, 62),
    (163, 37, 84),
    (98, 15, 98),
)
OBJECT_PLAIN = (214, 213, 210)
HAND = (146, 173, 203)
#: The table that an object rests on.
TABLE = (150, 128, 104)
#: Dots where the hand touches, on top of the contact scale.
TOUCHING = (20, 110, 160)
#: Contact regions by finger, apart from each other for colour-blind eyes too; the palm's own; the
#: arrow along the palm's normal; the x, y and z axis of a frame.
CHAINS = (
    (0, 150, 110), (222, 120, 10), (120, 70, 160), (0, 105, 180), (200, 60, 110), (130, 120, 20),
)  # fmt: skip
PALM_REGIONS, PALM_ARROW = (190, 160, 60), (40, 44, 52)
AXES = ((205, 50, 45), (50, 150, 60), (45, 90, 205))
PASS, FAIL, UNKNOWN = (26, 127, 80), (196, 52, 45), (110, 118, 129)


def contact_colors(values: np.ndarray | float) -> np.ndarray:
    """Contact values in [0, 1] as 8-bit sRGB, (..., 3) uint8."""
    steps = np.linspace(0.0, 1.0, len(CONTACT_SCALE))
    scale = np.asarray(CONTACT_SCALE, np.float64)
    channels = [np.interp(values, steps, scale[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def unit_rgb(color: tuple[int, int, int]) -> tuple[float, float, float]:
    """An 8-bit colour as floats in [0, 1]."""
    return color[0] / 255, color[1] / 255, color[2] / 255
