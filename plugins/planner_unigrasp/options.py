"""Options of the UniGrasp planner. Light: imports no numerical library."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.hand_learner_options import HandLearnerOptions

Weight = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Number = Annotated[int, Field(ge=1, le=4096)]


class UniGraspOptions(HandLearnerOptions):
    """Options of ``UniGraspPlanner``; none of them matters to training.

    Attributes:
        top: best-ranked sets of contact points that inverse kinematics is tried on: the paper's
            Top-1, Top-8, Top-32. No more grasps than this are found.
        contacts: fingers that get a contact point: the paper's at most 3, or the hand's number
            where that is smaller; 0 means all fingers.
        width: sets that are kept at each stage.
        branch: points that each of them is continued with.
        spacing_m: alternatives for one contact lie at least this far apart, metres.
        force_closure_weight: what ‖G f‖ of the best forces costs in the ranking, in nats.
        max_force_closure: sets above this are rejected.
        starts: poses from which each set is tried.
        refined: how many of these are kept for the second half, with penetration.
        steps: Adam steps of each half.
        learning_rate: of every entry of q (metres, rot6d, radians); it falls to a tenth.
        distance_weight: per metre of the mean distance of pads from their contact points.
        normal_weight: weight of the mean of 1 + ⟨n_pad, n_object⟩.
        penetration_weight: per metre of summed penetration, at the end.
        penetration_ramp: the weight grows geometrically by this factor up to there.
        self_weight: per metre of self-penetration.
        limit_weight: per radian of joint-limit violation.
        max_distance_m: a contact point farther than this from its pad is out of reach, metres.
        max_penetration_m: largest accepted depth, metres.
        max_self_m: largest accepted summed self-penetration, metres.
        close: flex fingers that are off the object until they touch it; not part of the method.
    """

    top: Number = 32
    contacts: Annotated[int, Field(ge=0, le=32)] = 3
    width: Number = 256
    branch: Number = 32
    spacing_m: Positive = 0.01
    force_closure_weight: Weight = 5.0
    max_force_closure: Positive = 0.3
    starts: Number = 8
    refined: Number = 2
    steps: Annotated[int, Field(ge=1)] = 80
    learning_rate: Positive = 0.01
    distance_weight: Weight = 100.0
    normal_weight: Weight = 0.3
    penetration_weight: Weight = 10.0
    penetration_ramp: Annotated[float, Field(ge=1)] = 30.0
    self_weight: Weight = 10.0
    limit_weight: Weight = 10.0
    max_distance_m: Positive = 0.01
    max_penetration_m: Positive = 0.005
    max_self_m: Positive = 0.005
    close: bool = False
