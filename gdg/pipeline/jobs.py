"""What each command takes. Light: imports nothing heavy."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gdg.config import JobConfig

#: Config key of a kind -> the component used unless another is named.
DEFAULTS = {
    "hand_model": "pytorch-kinematics",
    "distance": "aligned",
    "generator": "flow",
    "fitter": "halving",
    "planner": "contact-map",
    "simulator": "sapien",
}
#: Data synthesis needs no contact maps.
SYNTH_DEFAULTS = {**DEFAULTS, "planner": "dfc"}

#: The protocol of a table-top scene unless another is named.
TABLETOP_PROTOCOL = "tabletop-lift"

Count = Annotated[int, Field(ge=1, le=1_000_000)]


class PairJob(JobConfig):
    """One hand, one object.

    Attributes:
        hand: name or folder of the hand.
        object: name, folder or mesh file of the object.
        object_scale: factor from the mesh's unit to metres; 0.001 for millimetres.
        scene: free (the object floats in free air) or tabletop (it rests on a table, and the hand
            stays above it).
        scene_pose: with scene=tabletop: which of the object's resting poses, 0 the most probable.
        n: how many grasps.
        seed: of every random choice.
        device: ``cpu`` or ``cuda``; simulation always runs on the CPU.
        protocol: name of a stability protocol, or a YAML file with one; unless one is named,
            tabletop-lift with scene=tabletop.
        refine: close the hand by the protocol's contact-aware refinement.
    """

    hand: str
    object: str
    object_scale: Annotated[float, Field(gt=0)] = 1.0
    scene: Literal["free", "tabletop"] = "free"
    scene_pose: Annotated[int, Field(ge=0)] = 0
    n: Count = 8
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    device: Annotated[str, Field(pattern=r"^(cpu|cuda(:\d+)?)$")] = "cpu"
    protocol: str = "dro-2024"
    refine: bool = True

    @model_validator(mode="before")
    @classmethod
    def _protocol_of_the_scene(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("scene") == "tabletop":
            return {"protocol": TABLETOP_PROTOCOL, **given}
        return given

    @model_validator(mode="after")
    def _pose_of_a_scene(self) -> PairJob:
        if self.scene_pose and self.scene != "tabletop":
            raise ValueError(
                f"scene_pose={self.scene_pose}: counts poses on a table, and there is none; write "
                f"scene=tabletop, or leave it out"
            )
        return self


class GraspJob(PairJob):
    """What ``gdg grasp`` takes.

    Attributes:
        simulate: test the grasps in simulation.
        verified: go on proposing until n grasps pass the test, and give these alone. What words
            and files don't set (a run's config.yaml sets all) is then chosen so that more is
            proposed in the same time: planner.maps is 1, simulator.trials is decisive.
        most_proposed: with verified=true: give up after so many proposals per grasp asked for.
        workers: processes that test, at most, and with verified=true plan, too; 0 for one per core.
            There are fewer for few grasps, and one for a simulator that tests all grasps at once.
            Grasps and verdicts don't depend on it.
        out: run folder; by default ``runs/grasp/HAND-OBJECT-seedN``.
        picture: write the contact sheet ``grasps.png``.
        report: write the interactive ``report.html``.
    """

    simulate: bool = True
    verified: bool = False
    most_proposed: Annotated[int, Field(ge=1, le=1000)] = 8
    workers: Annotated[int, Field(ge=0, le=1024)] = 0
    out: str = ""
    picture: bool = True
    report: bool = True

    @model_validator(mode="after")
    def _test_to_verify(self) -> GraspJob:
        if self.verified and not self.simulate:
            raise ValueError("verified=true: needs the simulation; leave simulate=false out")
        if self.workers and not self.simulate:
            raise ValueError("workers: does nothing with simulate=false")
        if (
            not self.verified
            and self.most_proposed != type(self).model_fields["most_proposed"].default
        ):
            raise ValueError("most_proposed: does nothing without verified=true")
        return self


class EvalJob(PairJob):
    """What ``gdg eval`` takes; commas in any value span the grid.

    Attributes:
        out: folder of the evaluation.
        engine: local (processes of this machine) or ray (a Ray cluster).
        workers: processes that share the cells; 0 for one per core.
        threads: of each worker; grasps may differ in the last digits with another number.
        ray_address: of the Ray cluster, e.g. auto; by default RAY_ADDRESS, else one of its own.
        cell_timeout_s: a plan or a test that takes longer is stopped, and its cells fail; 0 for
            no limit.
    """

    out: str = "runs/eval"
    engine: Annotated[str, Field(pattern=r"^(local|ray)$")] = "local"
    workers: Annotated[int, Field(ge=0, le=65_536)] = 0
    threads: Annotated[int, Field(ge=1, le=1024)] = 1
    ray_address: str = ""
    cell_timeout_s: Annotated[float, Field(ge=0)] = 0.0


class SynthJob(PairJob):
    """What ``gdg synth`` takes; commas span the hands and objects.

    Attributes:
        n: passing grasps wanted per hand-object pair.
        shard: grasps asked of the planner per shard, the unit that is lost at most when a run is
            killed.
        max_shards: give a pair up after this many shards.
        give_up_after: give a pair up that has hardly any grasp after this many shards.
        give_up_below: fewer passing grasps than this are hardly any.
        shard_timeout_s: give a pair up when one of its shards takes longer; 0 for no limit.
        retry: go on with pairs that were given up, for give_up_after more shards.
        max_penetration_mm: of hand and object, by exact collision shapes; what is above is not
            simulated.
        max_self_penetration_mm: of the hand's links, likewise.
        keep_failed: store grasps that fail the simulation too; shards made before stay as they are.
        out: folder of the dataset.
        engine: local (processes of this machine) or ray (a Ray cluster).
        workers: processes that share the shards; 0 for one per core.
        objects_per_batch: shards of one hand, of as many objects, that a worker plans in one call,
            which fills a GPU; 0 for 16 with device=cuda, else 1.
        ray_address: of the Ray cluster, e.g. auto; by default RAY_ADDRESS, else one of its own.
    """

    n: Count = 100
    shard: Annotated[int, Field(ge=1, le=65_536)] = 128
    max_shards: Annotated[int, Field(ge=1, le=1_000_000)] = 20
    give_up_after: Annotated[int, Field(ge=1)] = 3
    give_up_below: Annotated[int, Field(ge=0)] = 1
    shard_timeout_s: Annotated[float, Field(ge=0)] = 3600.0
    retry: bool = False
    max_penetration_mm: Annotated[float, Field(ge=0)] = 1.0
    max_self_penetration_mm: Annotated[float, Field(ge=0)] = 1.0
    keep_failed: bool = False
    out: str = "runs/synth"
    engine: Annotated[str, Field(pattern=r"^(local|ray)$")] = "local"
    workers: Annotated[int, Field(ge=0, le=65_536)] = 0
    objects_per_batch: Annotated[int, Field(ge=0, le=1024)] = 0
    ray_address: str = ""
