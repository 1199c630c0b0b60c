"""Options of the force-closure planner."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.components import Options

Weight = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class DfcOptions(Options):
    """Options of ``DfcPlanner``.

    The recipe is DexGraspNet's (Wang et al. 2023), annealed in 800 steps in place of 6000, so it
    ends less exactly; thresholds are looser too (there: ‖G c‖ ≤ 0.3 summed over contacts, 5 mm,
    1 mm), and the simulator decides.

    Attributes:
        contacts: contact points per grasp.
        steps: MALA steps.
        batch: chains run at once.
        max_batches: give up after this many batches without enough accepted grasps.
        force_closure_weight: weight of ‖G c‖ / n, torques divided by the object's radius.
        distance_weight: per metre of Σ |δ(x_i)|.
        penetration_weight: per metre of Σ relu(−δ) over the hand's surface.
        self_weight: per metre of self-penetration.
        limit_weight: per radian of joint-limit violation.
        normal_weight: weight of Σ (1 + ⟨n_hand, n_object⟩), which turns pads toward the surface.
        step_size: Langevin step at the start; it decays by ``decay`` every ``step_period``.
        noise: standard deviation of Langevin's noise, as a share of the step (Liu et al. 2021).
        temperature: at the start; it decays by ``decay`` every ``temperature_period``.
        switch_probability: chance per step and chain that one contact moves to another region.
        surface_stride: penetration is summed over every so-manieth surface point while sampling;
            acceptance tests all of them.
        settle_share: share of the steps, at the end, in which no contact switches any more.
        max_force_closure: largest accepted ‖G c‖ / n.
        max_distance_m: largest accepted distance of a contact point, metres.
        max_penetration_m: largest accepted depth of a hand point, metres.
        max_self_m: largest accepted summed self-penetration, metres.
    """

    contacts: Annotated[int, Field(ge=2, le=32)] = 4
    steps: Annotated[int, Field(ge=1)] = 800
    batch: Annotated[int, Field(ge=1)] = 128
    max_batches: Annotated[int, Field(ge=1)] = 4
    force_closure_weight: Weight = 6.0
    distance_weight: Weight = 150.0
    penetration_weight: Weight = 100.0
    self_weight: Weight = 30.0
    limit_weight: Weight = 10.0
    normal_weight: Weight = 0.2
    step_size: Positive = 0.005
    noise: Weight = 0.1
    temperature: Positive = 2.0
    decay: Annotated[float, Field(gt=0, le=1)] = 0.95
    step_period: Annotated[int, Field(ge=1)] = 20
    temperature_period: Annotated[int, Field(ge=1)] = 8
    switch_probability: Annotated[float, Field(ge=0, le=1)] = 0.4
    surface_stride: Annotated[int, Field(ge=1)] = 4
    settle_share: Annotated[float, Field(ge=0, le=1)] = 0.3
    max_force_closure: Positive = 0.25
    max_distance_m: Positive = 0.006
    max_penetration_m: Positive = 0.002
    max_self_m: Positive = 0.002
