"""Measures how many simulated-valid grasps ``gdg synth`` makes per second, and on what it depends.

    python docs/figures/synthesis.py [--out docs/images] [--redraw]

Writes synthesis.csv and synthesis.png: throughput against the number of workers, the planner's
batch, the object's surface points, the cells of its signed-distance grid and the hand's surface
points. About six minutes on two quiet cores; ``--redraw`` only draws what the table says.
"""

from __future__ import annotations

import os

os.environ.update(OMP_NUM_THREADS="1")  # what a worker has

import argparse
import csv
import math
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from unittest.mock import patch

import matplotlib as mpl
import torch
from matplotlib import pyplot as plt

from gdg.cli.settings import configs_from, single
from gdg.data.info import dataset_info
from gdg.data.shards import iterate_shards
from gdg.geometry import sdf
from gdg.geometry.mesh import sample_surface
from gdg.objects.model import ObjectModel
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.synth import run_synth
from gdg.quality import exact_overlap
from gdg.report.palette import CONTACT_SCALE, HAND, unit_rgb

HAND_NAME, OBJECTS = "allegro", ("foam_brick", "lemon")
LIMIT_MM = 1.0
WORKERS = (1, 2)
SWEEPS = {
    "batch": (32, 64, 128, 256),
    "object points": (512, 1024, 2048, 4096),
    "grid cells": (64, 128, 192),
    "hand points": (400, 800, 1600, 3200),
}
#: Curves side by side in the picture.
ACROSS = 3
#: Sweeps of which one object says enough: much is sampled, or nothing depends on it.
ONE_OBJECT = ("batch", "object points")
#: Sweep -> axis label and the default that ``gdg synth`` has, if that is one of the values.
TITLES = {
    "workers": ("workers (processes)", None),
    "batch": ("planner.batch (chains at once)", 128),
    "object points": ("surface points of the object", 2048),
    "grid cells": ("cells along the longest side of the SDF", 128),
    "hand points": ("surface points of the hand", 1600),
}


@dataclass(frozen=True)
class Measured:
    """One point of a curve.

    Attributes:
        sweep: what was varied.
        value: to what.
        chains: that the planner ran.
        passed: grasps that are valid and held in simulation.
        plan_s: seconds of planning and of the exact filter.
        simulate_s: seconds of the simulation.
        seconds: of one process, or of the slowest worker.
    """

    sweep: str
    value: int
    chains: int
    passed: int
    plan_s: float
    simulate_s: float
    seconds: float

    @property
    def rate(self) -> float:
        """Passing grasps per second."""
        return self.passed / self.seconds


def main() -> None:
    """Measures, prints, writes the table and draws it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    images = Path(__file__).resolve().parents[1] / "images"
    parser.add_argument("--out", type=Path, default=images)
    parser.add_argument("--redraw", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    table = given.out / "synthesis.csv"
    rows: list[Measured] = []
    for row in () if given.redraw else measurements():
        print(f"{row.sweep} {row.value}: {row.passed} in {row.seconds:.1f} s, {row.rate:.2f}/s")
        rows.append(row)
        write_table(rows, table)
    draw(read_table(table), given.out / "synthesis.png")


def measurements() -> Iterator[Measured]:
    """All points of all curves; single processes are measured two at a time, as workers run."""
    for count in WORKERS:
        yield with_workers(count)
    tasks = [(sweep, value) for sweep, values in SWEEPS.items() for value in values]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context, initializer=warm_up) as pool:
        yield from pool.map(in_one_process, *zip(*tasks))


def warm_up() -> None:
    """Compiles, loads the simulator, fills the cache."""
    torch.set_num_threads(1)
    run(load(OBJECTS[0], batch=32), 32)


def in_one_process(sweep: str, value: int) -> Measured:
    """A point of a curve; its seconds are processor time of one thread."""
    chains = 256 if sweep == "batch" else 128
    names = OBJECTS[:1] if sweep in ONE_OBJECT else OBJECTS
    runs = [run(PAIRS[sweep](name, value), chains) for name in names]
    passed, plan_s, simulate_s = (sum(column) for column in zip(*runs, strict=True))
    total = chains * len(names)
    return Measured(sweep, value, total, int(passed), plan_s, simulate_s, plan_s + simulate_s)


def load(name: str, *words: str, batch: int = 128) -> Pair:
    """A pair whose planner runs batches of so many chains."""
    given = (
        f"hand={HAND_NAME}",
        f"object={name}",
        f"planner.batch={batch}",
        "planner.max_batches=1",
    )
    settings = (*given, "simulator.trials=decisive", *words)
    return Pair.load(single(configs_from(SynthJob, SYNTH_DEFAULTS, (), settings)))


def with_object(pair: Pair, change: Callable[[ObjectModel, int], ObjectModel], value: int) -> Pair:
    """The pair with a changed object."""
    return replace(pair, obj=change(pair.obj, value))


def with_points(obj: ObjectModel, count: int) -> ObjectModel:
    """The object with another number of surface points."""
    points, normals = sample_surface(obj.mesh, count, seed=0)
    return replace(
        obj,
        points=torch.as_tensor(points, dtype=torch.float32),
        normals=torch.as_tensor(normals, dtype=torch.float32),
    )


def with_grid(obj: ObjectModel, cells: int) -> ObjectModel:
    """The object with a coarser or finer signed-distance grid."""
    with patch.object(sdf, "RESOLUTION", cells):
        arrays = sdf.signed_distance_arrays(obj.mesh)
    values, origin = torch.from_numpy(arrays["values"]), torch.from_numpy(arrays["origin"])
    return replace(obj, sdf=sdf.SignedDistanceGrid(values, origin, float(arrays["spacing"])))


#: Sweep -> the pair of an object and a value of it.
PAIRS: dict[str, Callable[[str, int], Pair]] = {
    "batch": lambda name, batch: load(name, batch=batch),
    "object points": lambda name, count: with_object(load(name), with_points, count),
    "grid cells": lambda name, cells: with_object(load(name), with_grid, cells),
    "hand points": lambda name, count: load(name, f"hand_model.surface_points={count}"),
}


def run(pair: Pair, chains: int) -> tuple[int, float, float]:
    """Passing grasps of so many chains, seconds of planning, seconds of simulation."""
    generator, started = generator_for(0), time.process_time()
    clear = []
    while chains > 0:
        planned = pair.plan(10**6, generator, contact_maps=False)
        chains -= planned.provenance["candidates"]
        overlap = exact_overlap(pair.hand, pair.obj, planned)
        good = (overlap.object_mm <= LIMIT_MM) & (overlap.self_mm <= LIMIT_MM)
        clear.append(planned.select(good.nonzero()[:, 0].tolist()))
    planned_at = time.process_time()
    passed = sum(len(pair.simulate(grasps).passed) for grasps in clear if len(grasps))
    return passed, planned_at - started, time.process_time() - planned_at


def with_workers(count: int) -> Measured:
    """``gdg synth`` with so many processes, by the seconds that its shards took.

    Every worker makes two shards, of one object each, so that more workers get more work. What a
    worker takes to start (about ten seconds) is left out: it does not grow with the data set.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = (
            f"hand={HAND_NAME}", f"object={','.join(OBJECTS)}", f"out={folder}", f"workers={count}",
            "n=1000000", f"max_shards={count}", f"give_up_after={count}", "shard=65536",
            "planner.max_batches=1", "simulator.trials=decisive",
        )  # fmt: skip
        run_synth(configs_from(SynthJob, SYNTH_DEFAULTS, (), words))
        facts = [info.provenance for info in iterate_shards(Path(folder))]
        passed = dataset_info(Path(folder)).total().passed
    plan_s = sum(fact["seconds"]["plan"] + fact["seconds"]["filter"] for fact in facts) / count
    simulate_s = sum(fact["seconds"]["simulate"] for fact in facts) / count
    made = sum(fact["candidates"] for fact in facts)
    return Measured("workers", count, made, passed, plan_s, simulate_s, plan_s + simulate_s)


def write_table(rows: Sequence[Measured], path: Path) -> None:
    """The numbers behind the picture."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow([*asdict(rows[0]), "grasps_per_s"])
        for row in rows:
            values = asdict(row).values()
            rounded = [round(v, 2) if isinstance(v, float) else v for v in values]
            table.writerow([*rounded, round(row.rate, 3)])


def read_table(path: Path) -> list[Measured]:
    """What ``write_table`` wrote."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [
            Measured(
                row["sweep"],
                *(int(row[name]) for name in ("value", "chains", "passed")),
                *(float(row[name]) for name in ("plan_s", "simulate_s", "seconds")),
            )
            for row in csv.DictReader(stream)
        ]


def draw(rows: Sequence[Measured], path: Path) -> None:
    """One curve per sweep, with the counting error √k / seconds; a ring marks the default."""
    mpl.use("Agg")
    mpl.rcParams.update({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    names = list(dict.fromkeys(row.sweep for row in rows))
    rows_of_axes = math.ceil(len(names) / ACROSS)
    figure, axes = plt.subplots(
        rows_of_axes, ACROSS, figsize=(3.6 * ACROSS, 3.2 * rows_of_axes), sharey=True,
        squeeze=False, layout="constrained",
    )  # fmt: skip
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    for axis, name in zip(axes.flat, names):
        own = [row for row in rows if row.sweep == name]
        values, rates = [row.value for row in own], [row.rate for row in own]
        errors = [math.sqrt(row.passed) / row.seconds for row in own]
        axis.errorbar(values, rates, errors, marker="o", capsize=3, color=unit_rgb(HAND), lw=2)
        label, default = TITLES[name]
        if default in values:
            at = values.index(default)
            axis.plot(default, rates[at], "o", ms=13, mfc="none", mec=unit_rgb(CONTACT_SCALE[3]))
        axis.set_xscale("log", base=2)
        axis.set_xticks(values, [str(value) for value in values])
        axis.minorticks_off()
        axis.set_xlabel(label)
        axis.grid(axis="y", alpha=0.3)
    axes[0, 0].set_ylim(bottom=0)
    for axis in axes[:, 0]:
        axis.set_ylabel("passing grasps per second")
    figure.savefig(path, dpi=110)
    plt.close(figure)
    print(path)


if __name__ == "__main__":
    main()
