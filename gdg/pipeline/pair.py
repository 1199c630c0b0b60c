"""Builds what one hand-object job needs, and runs its two stages: plan, then simulate."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import torch

import gdg
from gdg.assemble import Assembler
from gdg.config import RunConfig
from gdg.contact_maps import contact_map_of
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel, find_object
from gdg.pipeline.jobs import PairJob
from gdg.protocols import load_protocol
from gdg.scenes.keep import keep_above
from gdg.scenes.place import check_protocol, on_table
from gdg.starts import simulated


@dataclass
class Pair:
    """A hand and an object with the configured components around them."""

    config: RunConfig
    job: PairJob
    hand: HandModel
    obj: ObjectModel
    components: Assembler

    @classmethod
    def load(cls, config: RunConfig, beside: Pair | None = None) -> Pair:
        """Loads hand and object and imports nothing else yet.

        Args:
            config: the pair's config.
            beside: a pair with the same hand, components and device, which this one shares.

        Raises:
            GdgError: anything the user named that is missing or malformed.
        """
        job: PairJob = config.job
        device = _device(job.device)
        # a typo must be told before minutes of work
        check_protocol(load_protocol(job.protocol), job.scene == "tabletop")
        obj = find_object(job.object, job.object_scale).to(device)
        if job.scene == "tabletop":
            obj = on_table(obj, job.scene_pose)
        if beside is not None:
            return cls(config, job, beside.hand, obj, beside.components)
        choice = config.components["hand_model"]
        hand = choice.record.load()(choice.options, find_hand(job.hand), device)
        return cls(config, job, hand, obj, Assembler(config.components))

    def plan(
        self,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
        *,
        contact_maps: bool = True,
    ) -> GraspSet:
        """Plans grasps and stamps them with where they came from.

        Args:
            count: how many, at most.
            generator: the random stream.
            progress: called as the planner advances.
            contact_maps: compute the hand-made contact maps, for pictures.
        """
        started = time.perf_counter()
        grasps = self.components.get("planner").plan(
            self.hand, self.obj, count, generator, progress
        )
        grasps = self.stamped(grasps, time.perf_counter() - started)
        if contact_maps and grasps.contact_values is None and len(grasps):
            maps = contact_map_of(
                self.hand, self.obj, self.hand.q_of(grasps), self.components.get("distance")
            )
            grasps = replace(grasps, contact_values=maps.values.cpu())
        return grasps

    def stamped(self, grasps: GraspSet, seconds: float) -> GraspSet:
        """What a planner gave, with where it came from and how long planning took.

        On a table, grasps that it forbids are left out and counted among the rejected ones.
        """
        grasps = keep_above(self.hand, self.obj, grasps)
        told = {**grasps.provenance.get("seconds", {}), "plan": seconds}
        return replace(
            grasps,
            provenance={**grasps.provenance, **self.provenance(), "seconds": told},
            scene=self.obj.scene,
        )

    def measured(self, grasps: GraspSet) -> GraspSet:
        """The grasps with overlap, contacts and what these resist; see ``gdg.quality.measure``."""
        from gdg.quality import measure  # libraries that planning alone does without

        return measure(self.hand, self.obj, grasps) if len(grasps) else grasps

    def simulate(
        self,
        grasps: GraspSet,
        progress: Progress | None = None,
        simulator: Simulator | None = None,
    ) -> GraspSet:
        """Tests grasps under the job's protocol; the result carries verdicts and drive targets.

        Args:
            grasps: as planned.
            progress: called as the simulator advances.
            simulator: other than the configured one: one of several processes, which do other
                things beside, so that the seconds in the provenance are those of their tests.
        """
        protocol = load_protocol(self.job.protocol)
        started = time.perf_counter()
        tested_by: Simulator = simulator or self.components.get("simulator")
        found = simulated(
            tested_by, self.hand, self.obj, grasps, protocol, self.job.refine, progress
        )
        took = time.perf_counter() - started
        if simulator is not None:
            took = sum(verdict.seconds for verdict in found.verdicts)
        seconds = {**grasps.provenance.get("seconds", {}), "simulate": took}
        # how many of which proposals passed says nothing of this test
        about = {key: told for key, told in grasps.provenance.items() if key != "yield"}
        return replace(found, provenance={**about, "seconds": seconds})

    def provenance(self) -> dict[str, Any]:
        """Versions and content hashes of everything that shaped the grasps."""
        return {
            "gdg": gdg.__version__,
            "seed": self.job.seed,
            "device": self.job.device,
            "hand_hash": self.hand.hand.content_hash,
            "object_hash": self.obj.content_hash,
            "object_notes": list(self.obj.notes),
            "hand_path": self.job.hand,
            "object_path": self.job.object,
            "object_scale": self.job.object_scale,
            "split": self.obj.split,
            "components": {
                key: {
                    "name": choice.record.name,
                    "provider": choice.record.provider,
                    "distribution": choice.record.distribution,
                    "version": choice.record.version,
                }
                for key, choice in self.config.components.items()
            },
        }


def generator_for(seed: int) -> torch.Generator:
    """The random stream of a job."""
    return torch.Generator().manual_seed(seed)


def _device(name: str) -> torch.device:
    device = torch.device(name)
    if device.type != "cuda":
        return device
    if not torch.cuda.is_available():
        raise GdgError(f"device={name}: torch finds no CUDA device here; write device=cpu.")
    count = torch.cuda.device_count()
    if device.index is not None and device.index >= count:
        raise GdgError(f"device={name}: torch finds {count} CUDA devices here, cuda:0 the first.")
    return device
