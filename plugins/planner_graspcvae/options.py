"""Options of the GraspCVAE planner. Light: imports no numerical library."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.hand_learner_options import HandLearnerOptions

Weight = Annotated[float, Field(ge=0)]


class GraspCvaeOptions(HandLearnerOptions):
    """Options of ``GraspCvaePlanner``; none of them matters to training.

    Attributes:
        temperature: standard deviation of the latent; the network is trained for 1.
        adapt: test-time adaptation: optimise each predicted grasp until its contact map agrees
            with the one that ContactNet predicts for it.
        adapt_steps: Adam steps of the adaptation.
        learning_rate: of every entry of q (metres, rot6d, radians) in the adaptation.
        retarget_every: ContactNet predicts the target anew in every so-manieth step.
        touch_weight: per metre of the mean gap of pads that are near the object.
        penetration_weight: per metre of summed depth, at the end of the adaptation.
        penetration_ramp: the weight grows geometrically by this factor up to there.
        limit_weight: weight of the joint-limit norm.
        self_weight: weight of self-penetration, per metre.
        close: flex fingers that are off the object until they touch it; not part of the method.
    """

    temperature: Annotated[float, Field(ge=0, le=3)] = 1.0
    adapt: bool = False
    adapt_steps: Annotated[int, Field(ge=1)] = 100
    learning_rate: Annotated[float, Field(gt=0)] = 3e-3
    retarget_every: Annotated[int, Field(ge=1)] = 10
    touch_weight: Weight = 5.0
    penetration_weight: Weight = 3.0
    penetration_ramp: Annotated[float, Field(ge=1)] = 30.0
    limit_weight: Weight = 1.0
    self_weight: Weight = 1.0
    close: bool = False
