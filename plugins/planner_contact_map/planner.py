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
                if stable and self.options.spread:
                    grasps = _spread_out(grasps, count, self.options.spread)
                else:
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
    best, map_of = dict[float, int](), grasps.metrics[MAP].tolist()
    for index in grasps.energies["total"].argsort(stable=True).tolist():
        best.setdefault(map_of[index], index)
    return _without_map(grasps).select(list(best.values())[:count])


def _spread_out(grasps: GraspSet, count: int, weight: float) -> GraspSet:
    """At most ``count`` grasps that hold and differ, lowest energy first; no ``MAP``.

    They are chosen one by one: of those of negative energy, which promise to hold, the one of least
    energy minus ``weight`` times the distance from the nearest one chosen before; of the others, if
    those are too few, likewise. The distance is the root mean square difference of the joints.
    """
    energies = grasps.energies["total"]
    left, chosen = list(range(len(grasps))), list[int]()
    nearest = torch.zeros_like(energies)
    while left and len(chosen) < count:
        holding = [row for row in left if energies[row] < 0] or left
        one = min(holding, key=lambda row: float(energies[row] - weight * nearest[row]))
        away = (grasps.joints - grasps.joints[one]).square().mean(-1).sqrt()
        nearest = torch.minimum(nearest, away) if chosen else away
        left.remove(one)
        chosen.append(one)
    return _without_map(grasps).select(sorted(chosen, key=lambda row: float(energies[row])))


def _without_map(grasps: GraspSet) -> GraspSet:
    return replace(grasps, metrics={k: v for k, v in grasps.metrics.items() if k != MAP})


def _closed(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> GraspSet:
    """The grasps with fingers flexed until they touch; on a table hands may rise meanwhile."""
    if not len(grasps):
        return grasps
    q = close_until_touch(hand, obj, hand.q_of(grasps), rise=True)
    grasps = replace(grasps, joints=q[:, ROOT_DIM:].cpu())
    return grasps if obj.table is None else replace(grasps, poses=root_pose(q).cpu())
