"""Options of planners whose network learned one hand. Light: imports no numerical library."""

from __future__ import annotations

from gdg.components import Options


class HandLearnerOptions(Options):
    """What the options of every ``gdg.hand_learner.HandLearner`` begin with.

    Attributes:
        weights: path of a ``.safetensors`` file that ``gdg train`` wrote, or the name of bundled
            weights; by default the bundled ones of the hand.
    """

    weights: str = ""
