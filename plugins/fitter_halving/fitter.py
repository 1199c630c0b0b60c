"""Fits a hand to contact maps in rounds of ever fewer particles on ever more object points."""

from __future__ import annotations

from collections.abc import Sequence

from gdg.fitting.particles import ParticleFitter, Round

from .options import HalvingOptions


class HalvingFitter(ParticleFitter[HalvingOptions]):
    """Successive halving (Karnin et al. 2013) of the paper's particles, coarse to fine.

    Most starts end in poor minima, which some dozens of the object's points tell soon; so the same
    time is better spent on many starts of which few are followed to the end.
    """

    def rounds(self) -> Sequence[Round]:
        """All rounds, with equally many steps; the last takes what does not divide, too."""
        return [self._round(number) for number in range(self.options.rounds)]

    def _round(self, number: int) -> Round:
        chosen, last = self.options, self.options.rounds - 1
        share = number / last
        finalists = min(max(chosen.finalists, chosen.keep), chosen.particles)
        steps = chosen.steps // chosen.rounds
        return Round(
            round(_between(chosen.particles, finalists, share)),
            steps if number < last else chosen.steps - last * steps,
            _between(chosen.learning_rate, chosen.last_learning_rate, share),
            round(_between(chosen.first_points, chosen.last_points, share)),
            round(_between(chosen.first_hand_stride, 1, share)),
        )


def _between(first: int | float, last: int | float, share: float) -> float:
    """Geometric interpolation."""
    return first * (last / first) ** share
