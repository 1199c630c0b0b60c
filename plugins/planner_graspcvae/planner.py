"""Regresses grasps of one hand from an object's points (GraspCVAE, Jiang et al. 2021)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import Tensor

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.hand_learner import HandLearner
from gdg.hand_weights import HandWeights
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.stopwatch import Stopwatch
from gdg.weights_files import WeightsFile

from .adapt import Agreement
from .network import LATENT, GraspNetworks, center_of
from .options import GraspCvaeOptions

if TYPE_CHECKING:
    from .module import GraspCvaeModule

#: Grasps adapted at once; bounds the memory.
MAX_BATCH = 256


class GraspCvaePlanner(HandLearner[GraspNetworks]):
    """One latent per grasp asked for, decoded to a pose; adapted at test time if so configured.

    Args:
        options: the weights to use and how to sample.
        distance: what contact maps are measured with in the adaptation and in the ranking.
    """

    options: GraspCvaeOptions
    stored: ClassVar[HandWeights] = HandWeights(
        Path(__file__).parent / "weights", "graspcvae", "gdg-graspcvae-2"
    )

    def __init__(self, options: GraspCvaeOptions, *, distance: Distance):
        super().__init__(options)
        self._distance = distance

    def plan(
        self,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """At most ``count`` grasps, best agreement with their predicted contact maps first.

        Latents are drawn one after the other: the first grasps of a larger ``count`` are, before
        sorting, those of a smaller one.

        Raises:
            GdgError: there are no weights for this hand, or they can't be read.
        """
        watch = Stopwatch()
        with watch.stage("generate"):
            weights, networks = self.loaded(hand)
            q = self._decoded(networks, hand, obj, count, generator)
        told = weights.metadata["distance"]
        agreement = Agreement(hand, obj, networks.contact, told, self._distance, self.options)
        if self.options.adapt and len(q):
            with watch.stage("fit"):
                q = self._adapted(agreement, q, progress)
        if self.options.close and len(q):
            with watch.stage("close"):
                q = close_until_touch(hand, obj, q)
        return self._judged(agreement, hand, obj, q, self._provenance(weights, watch.seconds))

    def network_of(self, hand: HandModel) -> GraspNetworks:
        """GraspCVAE and ContactNet."""
        return GraspNetworks(hand)

    @classmethod
    def module(cls) -> type[GraspCvaeModule]:
        """Both networks in training."""
        from .module import GraspCvaeModule  # Lightning takes seconds to import

        return GraspCvaeModule

    @torch.no_grad()
    def _decoded(
        self,
        networks: GraspNetworks,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
    ) -> Tensor:
        drawn = torch.randn(count, LATENT, generator=generator, device=generator.device)
        latents = self.options.temperature * drawn.to(hand.device)
        points = obj.points[None]
        condition = networks.cvae.condition(points).expand(count, -1)
        center = center_of(points).expand(count, -1, -1)
        return hand.clamp(networks.cvae.decode(condition, center, latents))

    def _adapted(self, agreement: Agreement, q: Tensor, progress: Progress | None) -> Tensor:
        """The grasps after test-time adaptation."""
        steps, batches = self.options.adapt_steps, q.split(MAX_BATCH)
        return torch.cat(
            [
                agreement.adapted(batch, _share(progress, number * steps, len(batches) * steps))
                for number, batch in enumerate(batches)
            ]
        )

    @torch.no_grad()
    def _judged(
        self,
        agreement: Agreement,
        hand: HandModel,
        obj: ObjectModel,
        q: Tensor,
        provenance: dict[str, Any],
    ) -> GraspSet:
        """The finite grasps with their energies, lowest total first."""
        finite = torch.isfinite(q).all(-1)
        q = q[finite]
        parts = [agreement.terms(part, agreement.targets(part)) for part in q.split(MAX_BATCH)]
        energies = {
            "total": torch.cat([agreement.total(terms) for terms in parts]),
            "contact": torch.cat([terms.contact for terms in parts]),
            "touch": torch.cat([terms.touch for terms in parts]),
            "penetration": torch.cat([terms.penetration for terms in parts]),
            "limits": torch.cat([terms.limits for terms in parts]),
            "self_penetration": torch.cat([terms.self_penetration for terms in parts]),
            "penetration_depth_mm": torch.cat([1000 * terms.depth for terms in parts]),
        }
        grasps = hand.grasps_from(
            q,
            obj.name,
            energies,
            # a regression ends by itself; the adaptation after its steps
            status=("hit_limit" if self.options.adapt else "converged",) * len(q),
            contact_values=torch.cat([terms.values for terms in parts]).cpu(),
            provenance={**provenance, "rejected": {"not finite": int((~finite).sum())}},
        )
        return grasps.select(grasps.energies["total"].argsort().tolist())

    def _provenance(self, weights: WeightsFile, seconds: dict[str, float]) -> dict[str, Any]:
        return {
            **self.stored.provenance(weights),
            "adapt": self.options.adapt,
            "distance": self._distance.label,
            "seconds": seconds,
        }


def _share(progress: Progress | None, done: int, total: int) -> Callable[[int], None]:
    """Reports the steps of one of several batches as those of all."""
    if progress is None:
        return lambda step: None
    return lambda step: progress(done + step, total)
