"""Options of the force-closure planner."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gdg.components import Options

Weight = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class DfcOptions(Options):
    """Options of ``DfcPlanner``.

    Attributes:
        sampler: ``annealed``: a short annealed MALA (after DexGraspNet, Wang et al. 2023);
            ``published``: the MALA of Liu et al. 2021 that GenDexGrasp used, with its own
            schedule, for reference; it takes no notice of options marked (annealed).
        contacts: contact points per grasp.
        steps: MALA steps.
        batch: chains run at once.
        max_batches: give up after this many batches without enough accepted grasps.
        oversample: chains started for each of the ``batch`` that go on (annealed).
        cull_at: share of the steps after which the others are dropped (annealed).
        force_closure_weight: weight of ‖G c‖ / n, torques divided by the object's reach.
        distance_weight: per metre of Σ |δ(x_i)|.
        penetration_weight: per metre of summed penetration (``gdg.penetration``).
        self_weight: per metre of self-penetration.
        limit_weight: per radian of joint-limit violation.
        normal_weight: weight of Σ (1 + ⟨n_hand, n_object⟩), which turns pads toward the surface.
        step_size: Langevin step at the start; it decays by ``decay`` every ``step_period``
            steps (annealed).
        noise: standard deviation of Langevin's noise, as a share of the step (annealed).
        decay: see ``step_size`` and ``temperature`` (annealed).
        step_period: see ``step_size`` (annealed).
        temperature: at the start; it decays by ``decay`` every ``temperature_period`` steps
            (annealed).
        temperature_period: see ``temperature`` (annealed).
        switch_probability: chance per step and chain that one contact moves (annealed).
        switch_tries: random places of which it takes one, the likelier the lower its energy
            (annealed).
        surface_stride: penetration is summed over every so-manieth surface point while sampling;
            acceptance tests all of them (annealed).
        settle_share: share of the steps, at the end, in which no contact switches any more
            (annealed).
        hardening: factor of both penetration weights at the end of them (annealed).
        clearance_m: the hand counts as so much thicker while sampling, metres: edges and corners
            reach deeper into an object than the sampled points between them (annealed).
        close: close the fingers of the final states until they touch the object.
        close_margin_m: distance at which a closing link touches, metres; see ``clearance_m``.
        max_force_closure: largest accepted ‖G c‖ / n.
        max_distance_m: largest accepted distance of a contact point, metres.
        max_penetration_m: largest accepted depth of a surface point or inscribed sphere, metres.
        max_self_m: largest accepted summed self-penetration, metres.
    """

    sampler: Literal["annealed", "published"] = "annealed"
    contacts: Annotated[int, Field(ge=2, le=32)] = 4
    steps: Annotated[int, Field(ge=1)] = 300
    batch: Annotated[int, Field(ge=1)] = 128
    max_batches: Annotated[int, Field(ge=1)] = 4
    oversample: Annotated[int, Field(ge=1)] = 6
    cull_at: Annotated[float, Field(ge=0, lt=1)] = 0.2
    force_closure_weight: Weight = 6.0
    distance_weight: Weight = 150.0
    penetration_weight: Weight = 100.0
    self_weight: Weight = 30.0
    limit_weight: Weight = 10.0
    normal_weight: Weight = 0.2
    step_size: Positive = 0.01
    noise: Weight = 0.3
    temperature: Positive = 2.0
    decay: Annotated[float, Field(gt=0, le=1)] = 0.95
    step_period: Annotated[int, Field(ge=1)] = 8
    temperature_period: Annotated[int, Field(ge=1)] = 3
    switch_probability: Share = 0.4
    switch_tries: Annotated[int, Field(ge=1)] = 16
    surface_stride: Annotated[int, Field(ge=1)] = 1
    settle_share: Share = 0.3
    hardening: Annotated[float, Field(ge=1)] = 8.0
    clearance_m: Weight = 0.0015
    close: bool = True
    close_margin_m: Weight = 0.001
    max_force_closure: Positive = 0.25
    max_distance_m: Positive = 0.006
    max_penetration_m: Positive = 0.001
    max_self_m: Positive = 0.001
