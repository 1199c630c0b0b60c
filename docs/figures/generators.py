"""Compares contact-map generators with true maps, without any simulation (Markdown table).

    python docs/figures/generators.py DATA [--split paper] [--objects 8] [--seed 0] \\
        cvae:runs/cvae/model.safetensors flow:runs/flow/model.safetensors,steps=8 ...

A generator is written NAME[:WEIGHTS][,option=value]. DATA is a dataset of gdg synth; compared is on
the validation objects of the split, which none of the generators may have been trained on. All
hands' maps of an object are mixed in equal shares, since a generator knows no hand.

Half of an object's true maps, drawn at random, are the reference, R; the row ``true maps`` is the
other half, T, and generators give as many as T has: no generator can be expected to do better. The
row ``average map`` is T's mean, the most blurred map there is. Columns, means over objects:

mass > 0.5    share of the maps' sum that lies on points with values above 0.5
spread        share of the surface that a map covers: exp(entropy of its mass) / number of points
highest       largest value of a map; a true map has a contact, so about 0.7 or more
regions       connected regions above 0.5, at most 8; points closer than 5 times the median distance
              to the nearest point are neighbours
to nearest    mean absolute difference to the nearest true map in R: precision, lower is better
from nearest  the same from each map of R to the nearest generated one: coverage (MMD)
covered       share of R that is nearest to at least one map (COV)
told apart    share of maps, generated and R, whose nearest other map is of their own kind (1-NNA):
              0.5 is best, 1 means that any map can be told from true ones
s per 32      processor seconds of one thread for 32 maps on an object, everything loaded
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from torch import Tensor

from gdg.config import ComponentChoice
from gdg.contact_maps import in_distance
from gdg.kinds.generator import Generator
from gdg.objects.model import ObjectModel, find_object
from gdg.registry import get_registry
from gdg.training.job import TrainJob
from gdg.training.source import ItemSource
from gdg.training.split import choose_shards

COLUMNS = (
    "mass > 0.5", "spread", "highest", "regions", "to nearest", "from nearest", "covered",
    "told apart", "s per 32",
)  # fmt: skip
MOST_REGIONS, NEIGHBOUR_GAPS = 8, 5.0
CONTACT = 0.5
TIMED_MAPS = 32

Maps = Float[Tensor, "map object_point"]


@dataclass(frozen=True)
class Truth:
    """An object and its true maps, halved.

    Attributes:
        obj: the object.
        reference: what generated maps are compared with.
        other: the other half.
    """

    obj: ObjectModel
    reference: Maps
    other: Maps


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data")
    parser.add_argument("generators", nargs="*")
    parser.add_argument("--split", default="paper")
    parser.add_argument("--objects", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_intermixed_args()
    torch.set_num_threads(1)
    choices = {kind: choice_of(kind, name) for kind, name in (
        ("distance", "aligned"), ("hand-model", "pytorch-kinematics"))}  # fmt: skip
    source = ItemSource(choices["distance"], choices["hand-model"])
    truths = true_maps(given.data, given.split, given.objects, given.seed, source)
    total = sum(len(truth.other) for truth in truths)
    print(f"{total} maps on {', '.join(truth.obj.name for truth in truths)}\n")
    print("| generator | " + " | ".join(COLUMNS) + " |\n|" + " --- |" * (len(COLUMNS) + 1))
    print_row("true maps", truths, lambda truth: truth.other)
    print_row("average map", truths, lambda truth: truth.other.mean(0).expand_as(truth.other))
    for text in given.generators:
        generator = generator_of(text)

        def draw(truth: Truth, generator: Generator = generator) -> Maps:
            random = torch.Generator().manual_seed(given.seed)
            drawn = generator.generate(truth.obj, len(truth.other), random)
            return in_distance(drawn, source.distance)

        print_row(text, truths, draw, lambda obj, one=generator: seconds(one, obj))


def choice_of(kind: str, name: str) -> ComponentChoice:
    """A component with its default options."""
    record = get_registry().find(kind, name)
    return ComponentChoice(record=record, options=record.options())


def generator_of(text: str) -> Generator:
    """The generator that ``NAME[:WEIGHTS][,option=value]`` means."""
    head, *options = text.split(",")
    name, _, weights = head.partition(":")
    given = dict(option.split("=", 1) for option in options)
    record = get_registry().find("generator", name)
    return record.load()(record.options(**({"weights": weights} if weights else {}), **given))


def true_maps(data: str, split: str, most: int, seed: int, source: ItemSource) -> list[Truth]:
    """The validation objects with their maps, equally many of each hand, shuffled and halved."""
    shards = choose_shards(TrainJob(data=data, split=split)).validation
    found: dict[str, dict[str, list[np.ndarray]]] = defaultdict(lambda: defaultdict(list))
    for info in shards:
        group = source.group(info)
        if group is not None:
            values = group.values
            stored = values if isinstance(values, np.ndarray) else np.load(str(values))
            key = info.object_path or info.object_name
            found[key][info.hand].append(stored)
    random = np.random.default_rng(seed)
    return [halved(key, hands, random) for key, hands in sorted(found.items())[:most]]


def halved(
    name: str, hands: Mapping[str, Sequence[np.ndarray]], random: np.random.Generator
) -> Truth:
    """An object's maps in two halves of one size."""
    of_hands = [random.permutation(np.concatenate(maps)) for maps in hands.values()]
    least = min(len(maps) for maps in of_hands)
    mixed = random.permutation(np.concatenate([maps[:least] for maps in of_hands]))
    half = len(mixed) // 2
    values = torch.from_numpy(mixed.astype(np.float32))
    return Truth(find_object(name), values[:half], values[half : 2 * half])


def print_row(
    name: str,
    truths: Sequence[Truth],
    draw: Callable[[Truth], Maps],
    timed: Callable[[ObjectModel], float] | None = None,
) -> None:
    """One line of the table."""
    measured = [measures(truth, draw(truth)) for truth in truths]
    columns = [float(np.mean(column)) for column in zip(*measured, strict=True)]
    spent = f"{np.mean([timed(truth.obj) for truth in truths]):.2f}" if timed else ""
    shown = [*(f"{value:.3f}" for value in columns), spent]
    print(f"| {name} | " + " | ".join(shown) + " |", flush=True)


def measures(truth: Truth, maps: Maps) -> list[float]:
    """The columns but the last, for one object."""
    high = maps * (maps > CONTACT)
    share = maps / maps.sum(1, keepdim=True).clamp(min=1e-9)
    entropy = -(share * share.clamp(min=1e-12).log()).sum(1)
    between = torch.cdist(maps, truth.reference, p=1) / maps.shape[1]
    return [
        float((high.sum(1) / maps.sum(1).clamp(min=1e-9)).mean()),
        float(entropy.exp().mean() / maps.shape[1]),
        float(maps.amax(1).mean()),
        contact_regions(truth.obj, maps),
        float(between.amin(1).mean()),
        float(between.amin(0).mean()),
        len(set(between.argmin(1).tolist())) / len(truth.reference),
        told_apart(maps, truth.reference),
    ]


def contact_regions(obj: ObjectModel, maps: Maps) -> float:
    """Mean number of connected regions of contact."""
    points = obj.points.numpy()
    tree = KDTree(points)
    gap = float(np.median(tree.query(points, k=2)[0][:, 1]))
    near = tree.sparse_distance_matrix(tree, NEIGHBOUR_GAPS * gap).tocsr()
    counts = []
    for row in (maps > CONTACT).numpy():
        chosen = np.flatnonzero(row)
        count = connected_components(near[chosen][:, chosen])[0] if len(chosen) else 0
        counts.append(min(count, MOST_REGIONS))
    return float(np.mean(counts))


def told_apart(maps: Maps, reference: Maps) -> float:
    """Accuracy of guessing a map's kind by its nearest other map."""
    pooled = torch.cat((maps, reference))
    distance = torch.cdist(pooled, pooled, p=1).fill_diagonal_(float("inf"))
    kinds = torch.arange(len(pooled)) < len(maps)
    return float((kinds[distance.argmin(1)] == kinds).float().mean())


def seconds(generator: Generator, obj: ObjectModel) -> float:
    """Processor seconds for 32 maps, after a first call."""
    generator.generate(obj, 1, torch.Generator().manual_seed(0))
    start = time.process_time()
    generator.generate(obj, TIMED_MAPS, torch.Generator().manual_seed(0))
    return time.process_time() - start


if __name__ == "__main__":
    main()
