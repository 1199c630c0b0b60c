"""Compares the planner's two samplers: the published MALA and the annealed one (Markdown table).

    python docs/figures/samplers.py [HAND ...]

One batch of chains per object; grasps that meet the thresholds and have at most 1 mm of overlap by
the exact collision shapes are simulated under dro-2024. Seconds are processor time of one thread.
"""

from __future__ import annotations

import sys
import time

import torch

from gdg.cli.settings import configs_from, single
from gdg.data.grasps import GraspSet
from gdg.metrics import direction_coverage, distinct_grasps, joint_diversity
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.quality import exact_overlap

OBJECTS = ("cube_small", "mouse", "torus_medium", "peach")
SAMPLERS = {
    "published": ("planner.sampler=published", "planner.steps=10000"),
    "annealed": ("planner.sampler=annealed",),
}
COLUMNS = (
    "hand", "sampler", "chains", "acceptance rate", "median energy", "meet thresholds", "valid",
    "s", "valid per s", "joint std (rad)", "direction coverage", "distinct of valid",
)  # fmt: skip


def main() -> None:
    """Prints the table."""
    torch.set_num_threads(1)
    print("| " + " | ".join(COLUMNS) + " |\n|" + " --- |" * len(COLUMNS))
    for hand in sys.argv[1:] or ["allegro"]:
        for sampler, words in SAMPLERS.items():
            print("| " + " | ".join(row(hand, sampler, words)) + " |", flush=True)


def row(hand: str, sampler: str, words: tuple[str, ...]) -> list[str]:
    """One line of the table: all objects pooled, measures of diversity averaged over them."""
    pairs = [load(hand, name, words) for name in OBJECTS]
    run(load(hand, OBJECTS[0], ("planner.steps=1", "planner.batch=2")))  # compiles, loads caches
    runs = [run(pair) for pair in pairs]
    planned, valid, seconds = zip(*runs, strict=True)
    energy = torch.cat([grasps.energies["total"] for grasps in planned]).median()
    rates = [grasps.provenance["acceptance_rate"] for grasps in planned]
    spread = [joint_diversity(grasps) for grasps in valid if len(grasps) > 1]
    coverage = [
        direction_coverage(pair.hand, grasps) for pair, grasps in zip(pairs, valid) if len(grasps)
    ]
    distinct = sum(distinct_grasps(grasps) for grasps in valid)
    count, total = sum(map(len, valid)), sum(seconds)
    return [
        hand, sampler, str(sum(grasps.provenance["candidates"] for grasps in planned)),
        f"{mean(rates):.2f}", f"{energy:.2f}", str(sum(map(len, planned))), str(count),
        f"{total:.0f}", f"{count / total:.2f}", f"{mean(spread):.3f}", f"{mean(coverage):.2f}",
        str(distinct),
    ]  # fmt: skip


def load(hand: str, name: str, words: tuple[str, ...]) -> Pair:
    """A pair whose planner runs one batch."""
    given = (f"hand={hand}", f"object={name}", "planner.max_batches=1", *words)
    return Pair.load(single(configs_from(SynthJob, SYNTH_DEFAULTS, (), given)))


def run(pair: Pair) -> tuple[GraspSet, GraspSet, float]:
    """Grasps that meet the thresholds, those that also pass, and planning's seconds."""
    started = time.process_time()
    planned = pair.plan(10**6, generator_for(0), contact_maps=False)
    seconds = time.process_time() - started
    if not len(planned):
        return planned, planned, seconds
    overlap = exact_overlap(pair.hand, pair.obj, planned)
    clear = ((overlap.object_mm <= 1) & (overlap.self_mm <= 1)).nonzero()[:, 0].tolist()
    tested = pair.simulate(planned.select(clear)) if clear else planned.select([])
    return planned, tested.select(tested.passed), seconds


def mean(values: list[float]) -> float:
    """Their mean, NaN of none."""
    return sum(values) / len(values) if values else float("nan")


if __name__ == "__main__":
    main()
