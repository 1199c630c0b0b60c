"""Contact maps first, the hand second (GenDexGrasp, Li et al. 2022)."""

from __future__ import annotations

import time
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

from .options import ContactMapOptions

#: Passing metric that says which of the generated maps, from 0, a grasp was fitted to.
MAP = "map"


class ContactMapPlanner(Planner):
    """One contact map per grasp asked for, and the best of its fits; drops fits that diverged."""

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
        """At most ``count`` grasps, one per map, lowest energy first; see the interface."""
        started = time.perf_counter()
        maps = self._generator.generate(obj, count, generator)
        generated = time.perf_counter()
        grasps = self._fitter.fit(hand, obj, maps, generator, progress)
        if self.options.close and len(grasps):
            closed = close_until_touch(hand, obj, hand.q_of(grasps), rise=True)
            grasps = replace(grasps, joints=closed[:, ROOT_DIM:].cpu())
            if obj.table is not None:
                grasps = replace(grasps, poses=root_pose(closed).cpu())
        fitted = time.perf_counter()
        rejected = {"diverged": grasps.status.count("diverged")}
        grasps = replace(grasps, provenance={**grasps.provenance, "rejected": rejected})
        grasps = self._chosen(hand, obj, grasps, len(maps))
        seconds = {
            "generate": generated - started,
            "fit": fitted - generated,
            "rank": time.perf_counter() - fitted,
        }
        return replace(grasps, provenance={**grasps.provenance, "seconds": seconds})

    def _chosen(self, hand: HandModel, obj: ObjectModel, grasps: GraspSet, maps: int) -> GraspSet:
        """The best fit of each map that has one, best first."""
        of_map = torch.arange(len(grasps)) // max(1, len(grasps) // max(1, maps))
        grasps = replace(grasps, metrics={**grasps.metrics, MAP: of_map.float()})
        sound = [i for i, status in enumerate(grasps.status) if status != "diverged"]
        grasps = keep_above(hand, obj, grasps.select(sound))
        if self.options.rank == "stability":
            grasps = judged_by_stability(hand, obj, grasps, self.options.max_overlap_mm)
        metrics, best = dict(grasps.metrics), dict[float, int]()
        map_of = metrics.pop(MAP).tolist()
        for index in grasps.energies["total"].argsort(stable=True).tolist():
            best.setdefault(map_of[index], index)
        return replace(grasps, metrics=metrics).select(list(best.values()))
