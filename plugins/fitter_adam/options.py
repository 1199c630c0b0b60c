"""Options of the Adam fitter."""

from __future__ import annotations

from gdg.fitting.options import FitOptions, Rate, Steps


class AdamOptions(FitOptions):
    """Options of ``AdamFitter``, beside those of every fit.

    Attributes:
        steps: Adam steps.
        learning_rate: of every entry of q (metres, rot6d, radians).
    """

    steps: Steps = 100
    learning_rate: Rate = 5e-3
