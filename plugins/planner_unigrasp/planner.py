"""Contact points first, fingers second (UniGrasp, Shao et al. 2020)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import Tensor

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hand_learner import HandLearner
from gdg.hand_weights import HandWeights
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import ROOT_DIM
from gdg.stopwatch import Stopwatch
from gdg.weights_files import WeightsFile

from .candidates import Candidates, candidates
from .fingers import Fingers, fingers_of
from .network import ContactSelection
from .options import UniGraspOptions
from .reach import Reach, Terms

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule

    from .module import UniGraspModule


class UniGraspPlanner(HandLearner[ContactSelection]):
    """Ranks sets of contact points and keeps those that the hand reaches.

    Args:
        options: the weights to use, how many sets, how to reach them.
    """

    options: UniGraspOptions
    stored: ClassVar[HandWeights] = HandWeights(
        Path(__file__).parent / "weights", "unigrasp", "gdg-unigrasp-2"
    )

    def plan(
        self,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """At most ``count`` grasps of ``options.top`` sets, the best set reached best first.

        The sets follow from the object alone; the generator decides where inverse kinematics
        starts. The total energy is the set's cost plus the energy of the fit.

        Raises:
            GdgError: there are no weights for this hand, they can't be read, its fingers came in
                another order when they were trained, or fewer than two have contact regions.
        """
        watch = Stopwatch()
        with watch.stage("generate"):
            weights, network = self.loaded(hand)
            fingers = fingers_of(hand)
            self._check_order(weights, hand, fingers)
            fingers = fingers.first(self.options.contacts or len(fingers))
            found = candidates(network, obj, len(fingers), self.options)
        reach = Reach(hand, obj, fingers, self.options)

        def report(step: int) -> None:
            if progress is not None:
                progress(step, reach.steps)

        q = torch.zeros(0, ROOT_DIM + len(hand.joint_names), device=hand.device)
        if len(found.index) and count:
            with watch.stage("fit"):
                q = reach.solve(found.index, generator, report)
        if self.options.close and len(q):
            with watch.stage("close"):
                q = close_until_touch(hand, obj, q)
        provenance = {
            **self.stored.provenance(weights),
            "top": self.options.top,
            "fingers": list(fingers.names),
            "seconds": watch.seconds,
        }
        return self._reached(reach, hand, obj, q, found, count, provenance)

    def network_of(self, hand: HandModel) -> ContactSelection:
        """A network with a stage for every finger."""
        return ContactSelection(len(fingers_of(hand)))

    @classmethod
    def module(cls) -> type[UniGraspModule]:
        """The selection network in training."""
        from .module import UniGraspModule  # Lightning takes seconds to import

        return UniGraspModule

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes the network with the finger of each stage, which the hand's body doesn't tell."""
        hand = module.hand
        assert isinstance(hand, HandModel)
        super().export(module, path, {**metadata, "fingers": list(fingers_of(hand).names)})

    def _check_order(self, weights: WeightsFile, hand: HandModel, fingers: Fingers) -> None:
        known, now = weights.metadata.get("fingers"), list(fingers.names)
        if known != now:
            command = self.stored.train_command(hand.hand)
            raise GdgError(
                f"{weights.path}: its stages are for the fingers {known}, but the order of "
                f"'{hand.hand.name}' in {hand.hand.folder} is {now}: its postures or "
                f"contact_regions have changed; train weights with '{command}'."
            )

    @torch.no_grad()
    def _reached(
        self,
        reach: Reach,
        hand: HandModel,
        obj: ObjectModel,
        q: Tensor,
        found: Candidates,
        count: int,
        provenance: dict[str, Any],
    ) -> GraspSet:
        """The grasps that meet every threshold, lowest total first."""
        sets = slice(0, len(q))
        index, cost, error = found.index[sets], found.cost[sets], found.force_closure[sets]
        terms = reach.terms(q, index)
        rejected = {"no force closure": found.rejected}
        good = torch.ones(len(q), dtype=torch.bool, device=q.device)
        for reason, failed in self._tests(q, terms).items():
            rejected[reason] = int((good & failed).sum())
            good &= ~failed
        fit = reach.total(terms)
        energies = {
            "total": cost + fit,
            "set": cost,
            "force_closure": error,
            "fit": fit,
            "distance": terms.distances.mean(-1),
            "normals": terms.normals,
            "penetration": terms.penetration,
            "self_penetration": terms.self_penetration,
            "limits": terms.limits,
            "penetration_depth_mm": 1000 * terms.depth,
        }
        grasps = hand.grasps_from(
            q,
            obj.name,
            energies,
            status=("converged",) * len(q),
            provenance={**provenance, "rejected": rejected},
        )
        order = grasps.energies["total"].argsort().tolist()
        return grasps.select([i for i in order if good[i]][:count])

    def _tests(self, q: Tensor, terms: Terms) -> dict[str, Tensor]:
        """Reason -> which poses are rejected for it, in the order in which they are tested."""
        o = self.options
        return {
            "not finite": ~torch.isfinite(q).all(-1),
            "contact out of reach": terms.distances.amax(-1) > o.max_distance_m,
            "penetration": terms.depth > o.max_penetration_m,
            "self-penetration": terms.self_penetration > o.max_self_m,
        }
