"""How time and memory grow, and where the time goes; refreshes docs/performance.md.

    python docs/figures/performance.py [--quick] [--write]

Give it an otherwise idle machine for half an hour. Fits whose memory counts have a process of their
own; each comes after one that compiles and warms up: wall seconds, the least of two, and how much
the process's memory grew at its peak (Linux). Fits of one table go in turn, so that a slow moment
of the machine hits all alike. Commands are timed as a shell sees them, start of Python included.
``--write`` puts the tables into docs/performance.md and draws docs/images/performance.png.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.ticker import LogLocator, NullLocator
from pages import write_tables

from gdg.config import compose
from gdg.data.grasps import load_grasps
from gdg.engine.threads import limit_threads, usable_cores
from gdg.evaluation.hardware import hardware
from gdg.kinds.fitter import Fitter
from gdg.kinds.generator import Generator
from gdg.nearest import EPSILON_M, nearest_hand_points
from gdg.nearest.eager import nearest_exhaustive
from gdg.objects.model import find_object
from gdg.pipeline.jobs import DEFAULTS, PairJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.registry import get_registry

DOCS = Path(__file__).resolve().parents[1]
PAGE, PICTURE = DOCS / "performance.md", DOCS / "images" / "performance.png"
#: Operations of the search per pair of points: 3 differences, two sums of products (5 each), square
#: root, sum, quotient, product, and 15 of the exponential.
OPERATIONS_PER_PAIR = 32
#: Triangles of the meshes whose preparation is timed.
MESH_FACES = 20_000
#: What is swept, a field of ``Setting`` or a further setting; the rest stays as it has it.
SWEEPS: tuple[tuple[str, tuple[object, ...]], ...] = (
    ("fitter.last_points", (256, 512, 1024, 2048)),
    ("hand_model.surface_points", (400, 800, 1600, 3200)),
    ("fitter.particles", (32, 64, 128, 256)),
    ("maps", (1, 2, 4, 8, 16, 32)),
    ("hand", ("ezgripper", "barrett", "allegro", "shadowhand")),
    ("fitter.max_memory_mb", (25, 50, 100, 250, 1000)),
)
#: Quality against time: (label, fitter, settings, values of the last one).
CURVES: tuple[tuple[str, str, tuple[str, ...], str, tuple[int, ...]], ...] = (
    ("adam, every step exact", "adam", ("fitter.search_every=1",), "fitter.steps", (25, 50, 100)),
    ("adam", "adam", (), "fitter.steps", (25, 50, 100, 200)),
    ("halving", "halving", (), "fitter.particles", (32, 64, 128, 256, 512)),
    (
        "halving, twice the points",
        "halving",
        ("fitter.first_points=128", "fitter.last_points=1024"),
        "fitter.particles",
        (64, 128, 256),
    ),
)


Answer = TypeVar("Answer")

#: Label of a curve -> (value of its last setting, seconds per map, energy) per point.
Curves = dict[str, list[tuple[int, float, float]]]


@dataclass(frozen=True)
class Setting:
    """A fit to be measured.

    Attributes:
        fitter: name.
        hand: name.
        maps: how many are fitted together.
        threads: that torch may use.
        words: further settings.
        object: name.
        seed: of the maps and the fit.
        device: ``cpu`` or ``cuda``.
    """

    fitter: str = "halving"
    hand: str = "shadowhand"
    maps: int = 8
    threads: int = 1
    words: tuple[str, ...] = field(default=())
    object: str = "rubber_duck"
    seed: int = 0
    device: str = "cpu"


@dataclass(frozen=True)
class Measured:
    """What a fit took, and gave.

    Attributes:
        seconds: per map.
        memory_mb: by which the process grew.
        energy: mean of the lowest total of each map.
        joints: of the hand.
    """

    seconds: float
    memory_mb: float
    energy: float
    joints: int


def main() -> None:
    """Measures, prints, writes, draws."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one round, fewer values")
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    given = parser.parse_args()
    rounds = 1 if given.quick else 2
    curves: Curves = {}

    def quality_part() -> str:
        curves.update(quality())
        return quality_table(curves)

    parts: dict[str, Callable[[], str]] = {
        # first, since a process begins with the peak of memory of the one that starts it
        "### From the shell": lambda: commands_table(rounds),
        "### Before the first grasp": lambda: cold_table(rounds),
        "### Fits": lambda: f"{scaling_table(rounds)}\n\n{cores_table(rounds)}",
        "### Quality against time": quality_part,
        "### Where the time of a grasp goes": lambda: stages_table(8 if given.quick else 16),
        "### The search for the nearest hand points": lambda: search_table(given.quick),
    }
    texts = [f"{hardware('cpu')}; {time.strftime('%Y-%m-%d')}."]
    print(texts[0])
    for title, measured in parts.items():
        texts += [title, measured()]
        print("", *texts[-2:], sep="\n\n", flush=True)
    if given.write:
        write_tables(PAGE, "\n\n".join(texts))
        draw(curves)


# -- the search --------------------------------------------------------------------------------


def search_table(quick: bool) -> str:
    """Compiled and tensor search, one thread, and how far from the machine's peak."""
    before = limit_threads(1)
    peak = matrix_peak()
    rows = []
    for particles, points, hand_points in (
        (8, 2048, 1600), (32, 2048, 1600), (128, 2048, 1600), (32, 512, 1600), (32, 8192, 1600),
        (32, 2048, 400), (32, 2048, 6400),
    ):  # fmt: skip
        drawn = torch.Generator().manual_seed(0)
        around = 0.05 * torch.randn(points, 3, generator=drawn)
        hand = 0.05 * torch.randn(particles, hand_points, 3, generator=drawn)
        arguments = (around, torch.nn.functional.normalize(around, dim=-1), hand, 1.0)
        compiled = least(lambda a=arguments: nearest_hand_points(*a), 5)
        eager = math.nan if quick else least(lambda a=arguments: nearest_exhaustive(*a, EPSILON_M))
        rate = OPERATIONS_PER_PAIR * particles * points * hand_points / compiled / 1e9
        rows.append(
            (
                particles, points, hand_points, f"{1000 * compiled:.1f} ms",
                f"{1000 * eager:.0f} ms", f"{eager / compiled:.1f}", f"{rate:.0f}",
                f"{100 * rate / peak:.0f} %",
            )
        )  # fmt: skip
    limit_threads(before)
    head = (
        "particles", "object points", "hand points", "compiled", "tensor operations",
        "times as fast", "10⁹ operations/s", f"of {peak:.0f} (float32 matrix product)",
    )  # fmt: skip
    return table(head, rows)


def matrix_peak(size: int = 1024) -> float:
    """10⁹ operations per second of a float32 matrix product."""
    a, b = torch.rand(size, size), torch.rand(size, size)
    return 2 * size**3 / least(lambda: a @ b, 10) / 1e9


def least(run: Callable[[], object], rounds: int = 3) -> float:
    """The least wall seconds of some runs, after one that warms up."""
    run()
    seconds = []
    for _ in range(rounds):
        started = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


# -- fits --------------------------------------------------------------------------------------


def scaling_table(rounds: int) -> str:
    """Seconds and memory while one thing grows."""
    settings = [varied(name, value) for name, values in SWEEPS for value in values]
    found = iter(in_turn(settings, rounds))
    rows = []
    for name, values in SWEEPS:
        for value in values:
            one = next(found)
            label = f"{value} ({one.joints} joints)" if name == "hand" else value
            rows.append((f"`{name}`", label, f"{one.seconds:.2f}", f"{one.memory_mb:.0f}"))
    return table(("what grows", "value", "s per map", "memory MB"), rows)


def varied(name: str, value: object) -> Setting:
    """The plain setting with one thing changed."""
    if hasattr(Setting, name):
        return replace(Setting(), **{name: value})  # type: ignore[arg-type]
    return Setting(words=(f"{name}={value}",))


def cores_table(rounds: int) -> str:
    """The same fit with one and more threads, and on a GPU if there is one."""
    counts = sorted({1, usable_cores()})
    settings = [Setting(fitter=f, threads=n) for f in ("halving", "adam") for n in counts]
    if torch.cuda.is_available():
        settings += [Setting(fitter=f, device="cuda", maps=64) for f in ("halving", "adam")]
    rows = [
        (f"`{s.fitter}`", s.device, s.threads, f"{one.seconds:.2f}", f"{one.memory_mb:.0f}")
        for s, one in zip(settings, in_turn(settings, rounds), strict=True)
    ]
    return table(("fitter", "device", "threads", "s per map", "memory MB"), rows)


def in_turn(settings: Sequence[Setting], rounds: int, each_alone: bool = True) -> list[Measured]:
    """Measures all settings as often, each in a fresh process or not; the least seconds of each."""
    results = []
    for _ in range(rounds):
        with ProcessPoolExecutor(
            1,
            mp_context=get_context("spawn"),
            max_tasks_per_child=1 if each_alone else len(settings),
        ) as processes:
            results.append(list(processes.map(measure, settings)))
    return [
        replace(
            of_one[0],
            seconds=min(one.seconds for one in of_one),
            memory_mb=max(one.memory_mb for one in of_one),
        )
        for of_one in zip(*results, strict=True)
    ]


def in_fresh_process(function: Callable[[str], Answer], argument: str) -> Answer:
    """What a function gives in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(function, argument).result()


def measure(setting: Setting) -> Measured:
    """Fits the maps of a setting."""
    limit_threads(setting.threads)
    words = (
        f"hand={setting.hand}", f"object={setting.object}", f"fitter={setting.fitter}",
        f"device={setting.device}", *setting.words,
    )  # fmt: skip
    (config,) = compose(PairJob, get_registry(), DEFAULTS, (), words)
    pair = Pair.load(config)
    generator: Generator = pair.components.get("generator")
    fitter: Fitter = pair.components.get("fitter")
    maps = generator.generate(pair.obj, setting.maps, generator_for(setting.seed))
    one = replace(maps, values=maps.values[:1])
    fitter.fit(pair.hand, pair.obj, one, generator_for(0))
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
    before = memory_mb("VmRSS")
    started = time.perf_counter()
    fits = fitter.fit(pair.hand, pair.obj, maps, generator_for(setting.seed))
    seconds = time.perf_counter() - started
    growth = memory_mb("VmHWM") - before
    energies = fits.energies["total"].reshape(setting.maps, -1)
    return Measured(
        seconds / setting.maps,
        growth,
        float(energies.amin(1).mean()),
        len(pair.hand.joint_names),
    )


def memory_mb(name: str) -> float:
    """What Linux says of this process: ``VmRSS`` is what it holds, ``VmHWM`` the most it held."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    (line,) = (line for line in lines if line.startswith(f"{name}:"))
    return int(line.split()[1]) / 1024


# -- quality -----------------------------------------------------------------------------------


def quality() -> Curves:
    """Lowest energies against seconds, means over hands and objects."""
    cases = [
        Setting(hand=hand, object=thing, maps=4)
        for hand in ("barrett", "shadowhand")
        for thing in ("rubber_duck", "camera")
    ]
    points = [
        (label, value, replace(case, fitter=fitter, words=(*words, f"{name}={value}")))
        for label, fitter, words, name, values in CURVES
        for value in values
        for case in cases
    ]
    found = in_turn([setting for _, _, setting in points], 1, each_alone=False)
    curves: Curves = {}
    for label, _, _, _, values in CURVES:
        for value in values:
            own = [
                one
                for (at, what, _), one in zip(points, found, strict=True)
                if (at, what) == (label, value)
            ]
            seconds, energy = (
                float(np.mean([getattr(one, name) for one in own]))
                for name in ("seconds", "energy")
            )
            curves.setdefault(label, []).append((value, seconds, energy))
    return curves


def quality_table(curves: Curves) -> str:
    """One row per point."""
    names = {label: name for label, _, _, name, _ in CURVES}
    rows = [
        (label, f"`{names[label]}={value}`", f"{seconds:.2f}", f"{energy:.4f}")
        for label, points in curves.items()
        for value, seconds, energy in points
    ]
    return table(("fit", "setting", "s per map", "lowest energy"), rows)


def draw(curves: Curves) -> None:
    """Energy over seconds."""
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for label, points in curves.items():
        _, seconds, energies = zip(*points, strict=True)
        axes.plot(seconds, energies, marker="o", label=label)
    axes.set(xscale="log", xlabel="seconds per map, one thread", ylabel="lowest energy of a map")
    axes.xaxis.set_major_locator(LogLocator(base=2))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right")
    figure.savefig(PICTURE, dpi=120)


# -- stages ------------------------------------------------------------------------------------


def stages_table(count: int) -> str:
    """Seconds of each stage per grasp, one thread."""
    before, rows = limit_threads(1), []
    for hand in ("barrett", "shadowhand"):
        words = (f"hand={hand}", "object=rubber_duck")
        (config,) = compose(PairJob, get_registry(), DEFAULTS, (), words)
        pair = Pair.load(config)
        pair.plan(1, generator_for(1))
        grasps = pair.simulate(pair.plan(count, generator_for(0)))
        seconds = grasps.provenance["seconds"]
        stages = ("generate", "fit", "close", "rank", "simulate")
        rows.append((hand, *(f"{seconds[stage] / count:.2f}" for stage in stages)))
    limit_threads(before)
    return table(
        ("hand", "generate s", "fit s (four maps)", "close s", "rank s", "simulate s (5 trials)"),
        rows,
    )


# -- commands ----------------------------------------------------------------------------------

#: Words of the ``gdg grasp`` commands that are measured.
COMMANDS = (
    "n=1",
    "n=1 workers=1",
    "n=1 planner.maps=1",
    "n=1 planner.maps=1 fitter=adam fitter.search_every=1",
    "n=8",
    "n=8 workers=1",
    "n=16 verified=true",
    "n=16 verified=true picture=false report=false",
    "n=16 verified=true fitter=adam fitter.search_every=1",
)


def commands_table(rounds: int) -> str:
    """Wall seconds and memory of ``gdg grasp``, after one that compiles and fills caches."""
    pair, rows = "hand=shadowhand object=rubber_duck", []
    with TemporaryDirectory() as folder:
        shell(f"{pair} {COMMANDS[0]}", folder)
        for words in COMMANDS:
            runs = [shell(f"{pair} {words}", folder) for _ in range(rounds)]
            seconds, memory = min(run[0] for run in runs), max(run[1] for run in runs)
            grasps = load_grasps(f"{folder}/grasps.json")
            told = grasps.provenance.get("yield")
            passed = f"{told['passed']} of {told['proposed']}" if told else "–"
            spread = f"{grasps.joints.std(0).mean():.3f}" if len(grasps) > 1 else "–"
            rows.append(
                (
                    f"`{words}`", f"{seconds:.1f}", f"{seconds / max(1, len(grasps)):.2f}", passed,
                    spread, f"{memory:.0f}",
                )
            )  # fmt: skip
    head = (
        f"`gdg grasp {pair} …`", "s", "s per grasp", "passed", "diversity rad",
        "memory MB (largest process)",
    )  # fmt: skip
    return table(head, rows)


def cold_table(rounds: int) -> str:
    """Wall seconds of imports, and of what is computed once per mesh; the least of some."""
    commands = {
        "`gdg --help`": ("-m", "gdg", "--help"),
        "`gdg hands list`": ("-m", "gdg", "hands", "list"),
        "imports of `gdg grasp`": ("-c", "import gdg.pipeline.grasp"),
    }
    rows = [
        (name, f"{min(spawned(words)[0] for _ in range(2 * rounds)):.2f}")
        for name, words in commands.items()
    ]
    for name in ("rubber_duck", "camera", "wine_glass"):
        with TemporaryDirectory() as folder:
            path = fine_mesh(name, Path(folder))
            grid, parts = (
                min(seconds)
                for seconds in zip(*(in_fresh_process(prepared, path) for _ in range(rounds)))
            )
        rows.append((f"`{name}` in {MESH_FACES} triangles: mesh and grid", f"{grid:.2f}"))
        rows.append((f"`{name}` in {MESH_FACES} triangles: convex parts", f"{parts:.2f}"))
    return table(("what", "s"), rows)


def fine_mesh(name: str, folder: Path) -> str:
    """The path of a mesh of ``MESH_FACES`` triangles, of a bundled object."""
    mesh = find_object(name).mesh
    while len(mesh.faces) < MESH_FACES:
        mesh = mesh.subdivide()
    mesh = mesh.simplify_quadric_decimation(face_count=MESH_FACES)
    path = folder / f"{name}.stl"
    mesh.export(path)
    return str(path)


def prepared(path: str) -> tuple[float, float]:
    """Seconds for a mesh's grid, and for its convex parts, with an empty cache."""
    with TemporaryDirectory() as folder:
        os.environ["GDG_CACHE"] = folder
        find_object("cube_small").convex_parts  # noqa: B018 so that libraries are loaded
        started = time.perf_counter()
        obj = find_object(path)
        between = time.perf_counter()
        obj.convex_parts  # noqa: B018 cut when first asked for
        return between - started, time.perf_counter() - between


def shell(words: str, folder: str) -> tuple[float, float]:
    """Seconds and megabytes of a ``gdg grasp`` that writes into a folder."""
    return spawned(("-m", "gdg", "grasp", *words.split(), f"out={folder}"))


def spawned(arguments: Sequence[str]) -> tuple[float, float]:
    """Seconds and megabytes of a Python with these arguments."""
    command = [sys.executable, *arguments]
    started = time.perf_counter()
    silence = (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)
    process = os.posix_spawn(sys.executable, command, os.environ, file_actions=[silence])
    _, status, used = os.wait4(process, 0)
    if status:
        raise RuntimeError(f"'{' '.join(command)}' failed")
    return time.perf_counter() - started, used.ru_maxrss / 1024


def table(head: Sequence[object], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


if __name__ == "__main__":
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    main()
