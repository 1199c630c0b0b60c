"""Fits a hand to contact maps with Adam (GenDexGrasp, Section III-C)."""

from __future__ import annotations

from collections.abc import Sequence

from gdg.fitting.particles import ParticleFitter, Round

from .options import AdamOptions


class AdamFitter(ParticleFitter[AdamOptions]):
    """The paper's fit: all particles take all steps, and compare the maps at all points."""

    def rounds(self) -> Sequence[Round]:
        """One round."""
        chosen = self.options
        return [Round(chosen.particles, chosen.steps, chosen.learning_rate)]
