"""Contact maps first, the hand second (GenDexGrasp, Li et al. 2022)."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.objects.model import ObjectModel
from gdg.quality.stability import judged_by_stability
from gdg.rotations import ROOT_DIM, root_pose
from gdg.scenes.keep import keep_above
from gdg.stopwatch import Stopwatch

from .options import ContactMapOptions

#: Passing metric that says which of the generated maps, from 0, a grasp was fitted to.
MAP = "map"


class ContactMapPlanner(Planner):
    """The best fit to each of some contact maps, and of these the best."""

    def __init__(self, options: ContactMapOptions, *, generator: Generator, fitter: Fitter):
        super().__init__(options)
        self.options = options
        self._generator, self._fitter = generator, fitter

    def plan(
        self,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """At most ``count`` grasps of as many maps, lowest energy first; see the interface."""
        watch = Stopwatch()
        with watch.stage("generate"):
            wanted = math.ceil(self.options.maps * count)
            maps = self._generator.generate(obj, wanted, generator)
        with watch.stage("fit"):
            fits = self._fitter.fit(hand, obj, maps, generator, progress)
        grasps = _sound(fits, len(maps))
        stable = self.options.rank == "stability"
        if not stable and obj.table is None:  # what is not chosen needs no closing
            with watch.stage("rank"):
                grasps = _best_of_each_map(grasps, count)
        if self.options.close:
            with watch.stage("close"):
                grasps = _closed(hand, obj, grasps)
        if stable or obj.table is not None:
            with watch.stage("rank"):
                grasps = keep_above(hand, obj, grasps)
                if stable:
                    most = self.options.max_overlap_mm
                    grasps = judged_by_stability(hand, obj, grasps, most)
                grasps = _best_of_each_map(grasps, count)
        return replace(grasps, provenance={**grasps.provenance, "seconds": watch.seconds})


def _sound(fits: GraspSet, maps: int) -> GraspSet:
    """The fits that did not diverge, each with the number of its map as the metric ``MAP``."""
    of_map = torch.arange(len(fits)) // max(1, len(fits) // max(1, maps))
    rejected = {"diverged": fits.status.count("diverged")}
    marked = replace(
        fits,
        metrics={**fits.metrics, MAP: of_map.float()},
        provenance={**fits.provenance, "rejected": rejected},
    )
    return marked.select([i for i, status in enumerate(fits.status) if status != "diverged"])


def _best_of_each_map(grasps: GraspSet, count: int) -> GraspSet:
    """The grasps of lowest energy, at most one of each map and ``count`` in all; no ``MAP``."""
    metrics, best = dict(grasps.metrics), dict[float, int]()
    map_of = metrics.pop(MAP).tolist()
    for index in grasps.energies["total"].argsort(stable=True).tolist():
        best.setdefault(map_of[index], index)
    return replace(grasps, metrics=metrics).select(list(best.values())[:count])


def _closed(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> GraspSet:
    """The grasps with fingers flexed until they touch; on a table hands may rise meanwhile."""
    if not len(grasps):
        return grasps
    q = close_until_touch(hand, obj, hand.q_of(grasps), rise=True)
    grasps = replace(grasps, joints=q[:, ROOT_DIM:].cpu())
    return grasps if obj.table is None else replace(grasps, poses=root_pose(q).cpu())
