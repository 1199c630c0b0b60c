"""Components that are spoilt on purpose, each to trip one check of the conformance kit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gdg_plugins.hand_pytorch_kinematics.model import PytorchKinematicsHand
from gdg_plugins.hand_pytorch_kinematics.options import PytorchKinematicsOptions
from gdg_plugins.planner_dfc.options import DfcOptions
from gdg_plugins.planner_dfc.planner import DfcPlanner
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from torch import Tensor
from training_samples import TinyGenerator, TinyPlanner

from gdg.components import NoOptions, Options
from gdg.data.contact_map import ContactMap
from gdg.kinds.distance import HandDistance
from gdg.kinds.generator import Generator

#: Loose enough that a few steps of eight chains give grasps.
QUICK_DFC = {
    "batch": 8, "steps": 5, "max_batches": 1, "max_distance_m": 1.0, "max_penetration_m": 1.0,
    "max_self_m": 1.0, "max_force_closure": 100.0,
}  # fmt: skip
QUICK_ADAM = {"particles": 4, "steps": 5}


class WrongGradient(EuclideanDistance):
    def to_hand(self, *args: Any):
        found = super().to_hand(*args)
        doubled = 2 * found.distance - found.distance.detach()
        return HandDistance(doubled, found.hand_index)


class DependsOnFrame(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        stretch = torch.tensor([1.0, 1.0, 1.5])
        return super().to_hand(
            object_points * stretch, object_normals, hand_points * stretch, *args
        )


class FarthestPoint(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        apart = torch.cdist(object_points.expand(len(hand_points), -1, -1), hand_points)
        return HandDistance(*apart.max(-1))


class IgnoresGivenPoints(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        return super().to_hand(object_points, object_normals, hand_points)


class HalfContact(EuclideanDistance):
    def contact_value(self, distance: Tensor) -> Tensor:
        return super().contact_value(distance) / 2


class OtherGap(AlignedDistance):
    def aligned_gap(self, value: Tensor) -> Tensor:
        return 2 * super().aligned_gap(value)


class Restless(EuclideanDistance):
    def to_hand(self, *args: Any):
        found = super().to_hand(*args)
        return HandDistance(found.distance + 1e-5 * torch.rand(()), found.hand_index)


class WritesIntoPoints(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        found = super().to_hand(object_points, object_normals, hand_points, *args)
        object_normals.zero_()
        return found


class DoubleDistance(EuclideanDistance):
    def to_hand(self, *args: Any):
        found = super().to_hand(*args)
        return HandDistance(found.distance.double(), found.hand_index)


class DropsEmptyBatches(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        if len(hand_points) == 0:
            hand_points = torch.zeros(1, 1, 3)
        return super().to_hand(object_points, object_normals, hand_points, *args)


class MixesHands(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        shift = hand_points.mean((0, 1)) if len(hand_points) else 0.0
        return super().to_hand(object_points, object_normals, hand_points + 0.1 * shift, *args)


class StepContact(EuclideanDistance):
    def contact_value(self, distance: Tensor) -> Tensor:
        value = super().contact_value(distance)
        return value.detach() + 0.0 * distance


class FirstHalf(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        half = hand_points[:, : (hand_points.shape[1] + 1) // 2]
        return super().to_hand(object_points, object_normals, half, *args)


class PlainRoot(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        index = super().to_hand(object_points, object_normals, hand_points, *args).hand_index
        nearest = hand_points.gather(1, index[..., None].expand(-1, -1, 3))
        return HandDistance((object_points - nearest).square().sum(-1).sqrt(), index)


class Raises(EuclideanDistance):
    def contact_value(self, distance: Tensor) -> Tensor:
        raise ZeroDivisionError("oh")


class OwnRandomness(Generator):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return ContactMap(obj.name, torch.rand(count, len(obj.points)), "aligned/release")


class UnknownLabel(Generator):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        values = torch.rand(count, len(obj.points), generator=generator)
        return ContactMap(obj.name, values, "aligend/release")


class UnknownPreset(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return replace(super().generate(obj, count, generator), distance="aligned/newest")


class OutOfRange(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        drawn = super().generate(obj, count, generator)
        return replace(drawn, values=2 * drawn.values, distance="aligned/release")


class OneMapTooMany(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return replace(super().generate(obj, count + 1, generator), distance="aligned/release")


class AtLeastOneMap(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        drawn = super().generate(obj, max(1, count), generator)
        return replace(drawn, distance="aligned/release")


class DoubleMaps(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        drawn = super().generate(obj, count, generator)
        return replace(drawn, values=drawn.values.double(), distance="aligned/release")


class SeedsEverything(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        torch.manual_seed(0)
        return replace(super().generate(obj, count, generator), distance="aligned/release")


class FixedPoints(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        values = torch.rand(count, 2048, generator=generator)
        return ContactMap(obj.name, values, "aligned/release")


class LearnsFromPictures(TinyGenerator):
    batch_kind = "pictures"  # type: ignore[assignment]


class OutOfLimits(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        fitted = super().fit(*args, **kwargs)
        return replace(fitted, joints=fitted.joints + 0.1)


class NoTotal(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        fitted = super().fit(*args, **kwargs)
        return replace(fitted, energies={"contact": fitted.energies["contact"]})


class OneGraspOnly(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        return super().fit(*args, **kwargs).select([0])


class OwnSeed(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        return super().fit(hand, obj, maps, torch.default_generator, progress)


class TakesAnyMap(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        same = replace(maps, distance=self.distance.label)
        return super().fit(hand, obj, same, generator, progress)


class NeedsMaps(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        return super().fit(hand, obj, maps, generator, progress).select(range(1))


class NeedsTwoMaps(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        if len(maps.values) == 1:
            maps = replace(maps, values=maps.values.repeat(2, 1))
        return super().fit(hand, obj, maps, generator, progress)


class StretchesMaps(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        values = torch.nn.functional.interpolate(maps.values[:, None], len(obj.points))[:, 0]
        return super().fit(hand, obj, replace(maps, values=values), generator, progress)


class DrawsWithNumpy(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        np.random.rand()  # noqa: NPY002
        return super().fit(*args, **kwargs)


class DoubleJoints(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        fitted = super().fit(*args, **kwargs)
        return replace(fitted, joints=fitted.joints.double())


class ProgressBeyondTheEnd(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        if progress is not None:
            progress(2, 1)
        return super().fit(hand, obj, maps, generator)


class Sheared(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        poses = super().link_poses_in_root(joints)
        return poses * torch.tensor([1.0, 1.0, 1.1, 1.0])


class DetachedJoints(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        poses = super().link_poses_in_root(joints)
        return poses.detach() + 0.0 * joints.sum()


class MixesTheBatch(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        return super().link_poses_in_root(joints.mean(0, keepdim=True).expand_as(joints))


class Wobbles(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        poses = super().link_poses_in_root(joints).clone()
        poses[:, 1:, 0, 3] += 1e-6 * torch.rand(())
        return poses


class DropsEmptyPoses(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        return super().link_poses_in_root(joints if len(joints) else self.lower[None])


class SwapsLimits(PytorchKinematicsHand):
    def __init__(self, *args: Any):
        super().__init__(*args)
        self.lower, self.upper = self.upper, self.lower


class MovesTheRoot(PytorchKinematicsHand):
    def link_poses(self, q: Tensor) -> Tensor:
        poses = super().link_poses(q).clone()
        poses[:, 0, 0, 3] += 0.001
        return poses


class IgnoresMimic(PytorchKinematicsHand):
    def __init__(self, *args: Any):
        super().__init__(*args)
        self._matrix = self._matrix * (self._matrix.abs().cumsum(0) <= 1)


class AlwaysPasses(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return tuple(replace(v, success=True, failure="") for v in super().simulate(*args))


class NeverPasses(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        found = super().simulate(*args)
        return tuple(replace(v, success=False, failure="moved") for v in found)


class Backward(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return super().simulate(*args)[::-1]


class Moody(SapienSimulator):
    runs = 0

    def simulate(self, *args: Any, **kwargs: Any):
        self.runs += 1
        off = 0.001 * self.runs
        return tuple(replace(v, displacement_m=(off,) * 6) for v in super().simulate(*args))


class LikesCompany(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, *args: Any, **kwargs: Any):
        found = super().simulate(hand, obj, grasps, *args)
        if len(grasps) > 1:
            return found
        return tuple(replace(v, displacement_m=(0.01,) * 6) for v in found)


class LikesOneSide(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, *args: Any, **kwargs: Any):
        found = super().simulate(hand, obj, grasps, *args)
        turned = grasps.poses[:, 0, 0] < 0.5
        return tuple(
            replace(v, success=False, failure="moved") if t else v for v, t in zip(found, turned)
        )


class AlwaysRefines(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return tuple(replace(v, refined=True) for v in super().simulate(*args))


class TakesAnyHand(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, *args: Any, **kwargs: Any):
        return super().simulate(hand, obj, replace(grasps, joint_names=hand.joint_names), *args)


class CountsDown(SapienSimulator):
    def simulate(
        self, hand: Any, obj: Any, grasps: Any, protocol: Any, progress: Any = None, *rest: Any
    ):
        for done in (1, 0):
            if progress is not None:
                progress(done, 1)
        return super().simulate(hand, obj, grasps, protocol, None, *rest)


class Weightless(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, protocol: Any, *args: Any, **kwargs: Any):
        if protocol.lift is not None and not protocol.needs_table:
            protocol = protocol.model_copy(update={"lift": None})
        return super().simulate(hand, obj, grasps, protocol, *args)


class TakesTablesAway(SapienSimulator):
    def simulate(
        self, hand: Any, obj: Any, grasps: Any, protocol: Any, progress: Any = None, *rest: Any
    ):
        if protocol.needs_table:
            lift = protocol.lift.model_copy(update={"support": "none"})
            protocol = protocol.model_copy(update={"lift": lift})
            obj = replace(obj, scene=None)
        return super().simulate(hand, obj, grasps, protocol, progress)


class ForgivesOverlap(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, protocol: Any, *args: Any, **kwargs: Any):
        start = protocol.start.model_copy(update={"max_initial_penetration_m": None})
        protocol = protocol.model_copy(update={"start": start})
        return super().simulate(hand, obj, grasps, protocol, *args)


class TensorDrift(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return tuple(replace(v, drift_m=np.float64(v.drift_m)) for v in super().simulate(*args))


class NoVerdicts(SapienSimulator):
    def simulate(self, hand: Any, obj: Any, grasps: Any, *args: Any, **kwargs: Any):
        return super().simulate(hand, obj, grasps, *args) if len(grasps) else None


class SeedsNumpy(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        np.random.seed(0)  # noqa: NPY002
        return super().plan(*args, **kwargs)


class NeedsAllPoints(DfcPlanner):
    def plan(self, hand: Any, obj: Any, *args: Any, **kwargs: Any):
        obj.points.reshape(2048, 3)
        return super().plan(hand, obj, *args, **kwargs)


class PlansFromPictures(DfcPlanner, TinyPlanner):
    batch_kind = "pictures"  # type: ignore[assignment]


class OneTooMany(DfcPlanner):
    def plan(self, hand: Any, obj: Any, count: int, generator: Any, progress: Any = None):
        return super().plan(hand, obj, count + 1, generator, progress)


class AtLeastTwo(DfcPlanner):
    def plan(self, hand: Any, obj: Any, count: int, generator: Any, progress: Any = None):
        return super().plan(hand, obj, max(2, count), generator, progress)


class MixesUpObjects(DfcPlanner):
    def plan_many(self, *args: Any, **kwargs: Any):
        return super().plan_many(*args, **kwargs)[::-1]


class WorstFirst(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        planned = super().plan(*args, **kwargs)
        return planned.select(range(len(planned))[::-1])


class ForgetsTheRejected(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        return replace(super().plan(*args, **kwargs), provenance={})


class Stretched(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        planned = super().plan(*args, **kwargs)
        return replace(planned, poses=1.1 * planned.poses)


#: Kind, spoilt component, the check that trips on it, what that says.
SABOTAGE: list[tuple[str, type, str, str]] = [
    ("distance", WrongGradient, "gradient", "gradient along x differs from finite differences"),
    ("distance", DependsOnFrame, "rigid motion", "depends on the frame"),
    ("distance", FarthestPoint, "minimum", "not the least of the distances"),
    ("distance", IgnoresGivenPoints, "given points", "a hand_index that is given must come back"),
    ("distance", HalfContact, "contact value", "the contact value at distance 0 is 0.5, not 1"),
    ("distance", OtherGap, "gaps", "does not give the gap"),
    ("distance", Raises, "contact value", "raised ZeroDivisionError: oh"),
    ("distance", Restless, "repetition", "the same points have another distance the second time"),
    ("distance", WritesIntoPoints, "repetition", "must not write into its arguments"),
    ("distance", DoubleDistance, "result", "distance must be float32"),
    ("distance", DropsEmptyBatches, "batches", "an empty batch of hands must give an empty batch"),
    ("distance", MixesHands, "batches", "hand 0 of a batch has another distance than by itself"),
    ("distance", FirstHalf, "permutations", "the order of the hand points changes the distance"),
    (
        "distance",
        PlainRoot,
        "gradient in contact",
        "gradient is not finite where",
    ),
    ("distance", StepContact, "contact slope", "gradient of contact_value differs"),
    ("generator", OwnRandomness, "randomness", "draw from the generator that is passed in"),
    ("generator", UnknownLabel, "label", "Did you mean 'aligned'"),
    ("generator", UnknownPreset, "label", "contact maps made with 'aligned/newest': preset"),
    ("generator", OutOfRange, "maps", "contact values must lie in [0, 1]"),
    ("generator", OneMapTooMany, "maps", "count=1 gave values of shape (2, 2048), not (1, 2048)"),
    ("generator", AtLeastOneMap, "maps", "count=0 gave values of shape (1, 2048), not (0, 2048)"),
    ("generator", DoubleMaps, "maps", "values must be float32"),
    ("generator", SeedsEverything, "randomness", "the global random state of torch changed"),
    ("generator", FixedPoints, "other points", "of 100 points got maps of shape (1, 2048)"),
    ("generator", LearnsFromPictures, "training", "batch_kind is 'pictures'"),
    ("fitter", OutOfLimits, "grasps", "joint 'close' is outside its limits"),
    ("fitter", NoTotal, "grasps", "energies must have 'total'"),
    ("fitter", OneGraspOnly, "grasps", "2 maps gave 1 grasps"),
    ("fitter", OwnSeed, "grasps", "draw from the generator passed in"),
    ("fitter", TakesAnyMap, "foreign maps", "maps of an unknown distance must raise"),
    ("fitter", NeedsMaps, "no map", "no map: raised IndexError"),
    ("fitter", NeedsTwoMaps, "one map", "2 maps gave"),
    ("fitter", StretchesMaps, "maps of another object", "another number of points must raise"),
    ("fitter", DrawsWithNumpy, "randomness", "the global random state of numpy changed"),
    ("fitter", DoubleJoints, "grasps", "joints must be float32"),
    ("fitter", ProgressBeyondTheEnd, "grasps", "with more steps done than there are"),
    ("hand-model", Sheared, "link poses", "link poses are not rigid"),
    ("hand-model", DetachedJoints, "gradient", "gradients in the joints differ"),
    ("hand-model", MixesTheBatch, "batches", "row 0 of a batch differs from the same row alone"),
    ("hand-model", IgnoresMimic, "predicted poses", "link 'right' is not where its joint puts it"),
    ("hand-model", Wobbles, "batches", "the same joint values give other poses the second time"),
    ("hand-model", DropsEmptyPoses, "batches", "must give an empty batch of link poses"),
    ("hand-model", SwapsLimits, "names and limits", "must be the limits of the URDF"),
    ("hand-model", MovesTheRoot, "root motion", "link_poses does not follow the root's pose"),
    ("simulator", AlwaysPasses, "absent hand", "a hand one metre away must not pass"),
    ("simulator", NeverPasses, "firm grasp", "press on the cube's middle must hold it"),
    ("simulator", Backward, "firm grasp", "must hold it"),
    ("simulator", Weightless, "lifted grasp", "two jaws that press on the cube must lift it"),
    ("simulator", TakesTablesAway, "cube on a table", "must sink with it, not by"),
    ("simulator", ForgivesOverlap, "initial overlap", "must fail as penetrating"),
    ("simulator", Moody, "repetition", "in a second run, a grasp's object moved by"),
    ("simulator", LikesCompany, "alone", "alone instead of among others"),
    ("simulator", LikesOneSide, "turned grasp", "turned by 90° around the cube is judged"),
    ("simulator", AlwaysRefines, "no targets", "refined must be false"),
    ("simulator", TakesAnyHand, "foreign grasps", "with other joints must raise a GdgError"),
    ("simulator", CountsDown, "progress", "progress went backward"),
    ("simulator", TensorDrift, "verdicts", "drift_m holds a float64, not a plain Python value"),
    ("simulator", NoVerdicts, "verdicts", "no grasps must give no verdicts"),
    ("planner", OneTooMany, "grasps", "3 grasps were asked for, 4 given"),
    ("planner", AtLeastTwo, "one grasp", "one grasp was asked for, several given"),
    ("planner", WorstFirst, "grasps", "grasps must come best first"),
    ("planner", ForgetsTheRejected, "grasps", "provenance['rejected'] must count"),
    ("planner", Stretched, "grasps", "poses are not rigid"),
    ("planner", SeedsNumpy, "randomness", "the global random state of numpy changed"),
    ("planner", MixesUpObjects, "many objects", "object_name is"),
    ("planner", PlansFromPictures, "training", "batch_kind is 'pictures'"),
    ("planner", NeedsAllPoints, "other points", "other points: raised RuntimeError"),
]
#: Base class -> its options model and what its instances use.
OPTIONS: dict[type, tuple[type[Options], tuple[str, ...], dict[str, Any]]] = {
    EuclideanDistance: (NoOptions, (), {}),
    AlignedDistance: (AlignedOptions, (), {}),
    Generator: (NoOptions, (), {}),
    AdamFitter: (AdamOptions, ("distance",), QUICK_ADAM),
    PytorchKinematicsHand: (PytorchKinematicsOptions, (), {"surface_points": 200}),
    SapienSimulator: (SapienOptions, (), {}),
    DfcPlanner: (DfcOptions, (), QUICK_DFC),
}
