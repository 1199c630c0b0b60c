"""Checks of generators: shape, range, randomness, label."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import torch

from gdg.contact_maps import in_distance
from gdg.data.contact_map import ContactMap
from gdg.errors import GdgError
from gdg.kinds.generator import Generator
from gdg.objects.model import ObjectModel
from gdg.pipeline.jobs import DEFAULTS
from gdg.registry import get_registry
from gdg.testing.checks import differ, moved_global_state, seeded
from gdg.testing.fixtures import model_of, small_cube, two_jaws
from gdg.testing.trainable import training_problems

COUNT = 3
#: Far fewer than the 2048 points that objects have.
FEW_POINTS = 100


@dataclass(frozen=True)
class GeneratorCase:
    """A generator with the object that it draws maps on."""

    generator: Generator

    @cached_property
    def obj(self) -> ObjectModel:
        """The cube, with all its points: networks may rely on their number."""
        return small_cube()

    def draw(self, count: int, seed: int) -> ContactMap:
        """Maps drawn from a fixed seed."""
        return self.generator.generate(self.obj, count, seeded(seed))


def maps(case: GeneratorCase) -> Iterator[str]:
    """Shape and range are as documented, for no map and for one as for several."""
    for count in (0, 1, COUNT):
        drawn = case.draw(count, seed=0)
        wanted = (count, len(case.obj.points))
        if drawn.values.shape != wanted:
            yield f"count={count} gave values of shape {tuple(drawn.values.shape)}, not {wanted}."
        if drawn.values.dtype != torch.float32:
            yield f"values must be float32, not {drawn.values.dtype}."
        if not bool(((drawn.values >= 0) & (drawn.values <= 1)).all()):
            yield "contact values must lie in [0, 1]."
        if drawn.object_name != case.obj.name:
            yield f"object_name is '{drawn.object_name}', not '{case.obj.name}'."


def randomness(case: GeneratorCase) -> Iterator[str]:
    """The same generator state gives the same maps."""
    yield from moved_global_state(lambda: case.draw(COUNT, seed=1))
    if differ(case.draw(COUNT, seed=1).values, case.draw(COUNT, seed=1).values, 1e-6):
        yield "the same generator state gave other maps: draw from the generator that is passed in."


def label(case: GeneratorCase) -> Iterator[str]:
    """The maps name a distance that a plugin provides."""
    drawn = case.draw(1, seed=0)
    record = get_registry().find("distance", DEFAULTS["distance"])
    try:
        in_distance(drawn, record.load()(record.options()))
    except GdgError as error:
        yield f"the maps' distance is '{drawn.distance}': {error}"


def other_points(case: GeneratorCase) -> Iterator[str]:
    """On an object with fewer points the maps are as long, or the object is refused."""
    obj = small_cube(FEW_POINTS)
    with suppress(GdgError):
        drawn = case.generator.generate(obj, 1, seeded())
        if drawn.values.shape != (1, FEW_POINTS):
            yield f"an object of {FEW_POINTS} points got maps of shape {tuple(drawn.values.shape)}."


def training(case: GeneratorCase) -> Iterator[str]:
    """A generator that learns can be trained, repeatably."""
    yield from training_problems(case.generator, model_of(two_jaws()), case.obj)


CHECKS = (maps, randomness, label, other_points, training)
