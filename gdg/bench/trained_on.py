"""Whether weights may stand in a row, by what their file says they were trained on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pydantic import BaseModel, ValidationError

from gdg.bench.tables import Method
from gdg.bench.weights import RowWeights, body_of
from gdg.config import RunConfig
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.identity import Assets
from gdg.objects.spec import MANIFEST, read_object_spec
from gdg.splits import bare_name


class RefusedWeights(GdgError):
    """A row's weights were trained otherwise than the row says."""


class TrainedOn(BaseModel, frozen=True):
    """What ``gdg train`` writes beside weights, as far as it matters here.

    Attributes:
        distance: label of the distance whose maps were learned.
        hands: names of the hands that were seen.
        held_out_hands: names of those that were kept away.
        hand_hashes: name -> content hash of the seen ones.
        train_objects: names of the objects that were learned from.
        validation_objects: names of those that chose the epoch.
        object_hashes: name -> content hash of both.
        hand_body: of the hand that a planner was trained for; "" for a generator.
    """

    distance: str
    hands: tuple[str, ...]
    held_out_hands: tuple[str, ...]
    hand_hashes: dict[str, str]
    train_objects: tuple[str, ...]
    validation_objects: tuple[str, ...]
    object_hashes: dict[str, str]
    hand_body: str = ""

    @classmethod
    def of(cls, weights: RowWeights) -> TrainedOn:
        """What a file says.

        Raises:
            RefusedWeights: it does not say all of this.
        """
        try:
            return cls.model_validate(weights.said)
        except ValidationError as error:
            lacking = ", ".join(str(part["loc"][0]) for part in error.errors())
            raise RefusedWeights(
                f"{weights.path} doesn't say what it was trained on ({lacking}); train with "
                f"'gdg train', which does."
            ) from error

    def saw(self, objects: TableObjects) -> list[str]:
        """Names of the tested objects that were seen, by name or by content."""
        names = {bare_name(name) for name in (*self.train_objects, *self.validation_objects)}
        known = set(self.object_hashes.values())
        return sorted(
            (names & objects.names) | {name for key, name in objects.hashes.items() if key in known}
        )


@dataclass(frozen=True)
class TableObjects:
    """The objects that a table tests on.

    Attributes:
        names: without dataset and scale.
        hashes: content hash -> name.
    """

    names: frozenset[str]
    hashes: Mapping[str, str]

    @classmethod
    def of(cls, configs: Iterable[RunConfig], assets: Assets) -> TableObjects:
        """Those of the configs that can be read; the others are told when they are to be used."""
        hashes: dict[str, str] = {}
        for given, scale in dict.fromkeys((c.job.object, c.job.object_scale) for c in configs):
            content = assets.object_hash(given, scale)
            if content is not None:
                hashes[content] = _object_name(given)
        return cls(frozenset(hashes.values()), hashes)


def check_weights(
    method: Method, weights: RowWeights, objects: TableObjects, assets: Assets
) -> None:
    """Checks that weights were trained as the row says, by what their file says.

    Raises:
        RefusedWeights: a hand was seen that the row holds out, or another one than the row has
            seen; the distance is another; or an object of the table was trained on, or chose the
            epoch.
    """
    told = TrainedOn.of(weights)
    if seen := told.saw(objects):
        raise RefusedWeights(
            f"{weights.path} has seen objects of this table in training: {', '.join(seen)}."
        )
    if method.planner_weights:
        if told.hand_body != body_of(method, assets):
            raise RefusedWeights(f"{weights.path} is for another hand than this {method.hand}.")
        return
    distance = told.distance.partition("/")[0]
    if distance != method.distance:
        raise RefusedWeights(
            f"{weights.path} was trained with the distance '{distance}', but the row is of "
            f"'{method.distance}'."
        )
    _check_hands(method, weights, told, assets)


def _check_hands(method: Method, weights: RowWeights, told: TrainedOn, assets: Assets) -> None:
    name, hand = method.hand, assets.hand(method.hand)
    if method.held_out:
        if name in told.hands:
            raise RefusedWeights(f"{weights.path} was trained on {name}.")
        if name not in told.held_out_hands:
            raise RefusedWeights(
                f"{weights.path} does not say that {name} was held out; train with "
                f"exclude_hand={name}."
            )
    elif name not in told.hands:
        seen = ", ".join(told.hands) or "none"
        raise RefusedWeights(f"{weights.path} was not trained on {name}, only on {seen}.")
    elif hand and told.hand_hashes.get(name) != hand.content_hash:
        raise RefusedWeights(
            f"{weights.path} was trained on another {name} than {hand.folder}; test the hand that "
            f"was trained on (without GDG_HANDS_PATH, say), or train on this one."
        )


def _object_name(given: str) -> str:
    """The bare name of an object that is there."""
    found = OBJECTS.find(given).path
    named = (found / MANIFEST).is_file()
    return bare_name(read_object_spec(found).name if named else found.stem)
