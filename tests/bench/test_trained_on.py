"""Weights that were trained otherwise than a row says don't stand in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bench_weights import write_row_weights

from gdg.bench.tables import Method
from gdg.bench.trained_on import RefusedWeights, TableObjects, check_weights
from gdg.bench.weights import RowWeights
from gdg.config import compose
from gdg.hands.hand import find_hand
from gdg.identity import Assets, body_hash, object_hash
from gdg.pipeline.jobs import DEFAULTS, EvalJob
from gdg.registry import get_registry

OWN = {"hands": ["two_jaws"], "held_out_hands": []}


def unseen(distance: str = "aligned") -> Method:
    words = ("planner=contact-map",)
    return Method("a", "two_jaws", words, weights="without-two_jaws", distance=distance)


def seen() -> Method:
    return Method("b", "two_jaws", ("planner=contact-map",), weights="full")


def regressed() -> Method:
    return Method("c", "two_jaws", ("planner=other",), planner_weights=True)


def table_objects(*objects: str) -> TableObjects:
    word = f"object={','.join(objects or ('apple', 'pear'))}"
    words = ["hand=two_jaws", word]
    return TableObjects.of(compose(EvalJob, get_registry(), DEFAULTS, (), words), Assets())


def checked(method: Method, tmp_path: Path, *objects: str, **said: Any) -> None:
    weights = RowWeights.of("any", write_row_weights(tmp_path / "any.safetensors", **said))
    check_weights(method, weights, table_objects(*objects), Assets())


def content_hash() -> str:
    return find_hand("two_jaws").content_hash


def test_weights_that_are_what_the_row_says_pass(tmp_path: Path):
    checked(unseen(), tmp_path)
    checked(unseen("euclidean"), tmp_path, distance="euclidean/release")
    checked(seen(), tmp_path, **OWN, hand_hashes={"two_jaws": content_hash()})
    body = body_hash(find_hand("two_jaws"))
    checked(regressed(), tmp_path, **OWN, hand_body=body, hand="jaws")


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"hands": ["barrett", "two_jaws"]}, r"was trained on two_jaws\.$"),
        ({"held_out_hands": []}, "does not say that two_jaws was held out; .* exclude_hand=two"),
        ({"distance": "euclidean"}, "with the distance 'euclidean', but the row is of 'aligned'"),
        ({"train_objects": None}, r"doesn't say what it was trained on \(train_objects\)"),
        ({"hand_hashes": [1]}, r"doesn't say what it was trained on \(hand_hashes\)"),
    ],
)
def test_weights_of_other_hands_and_distances_are_refused(
    tmp_path: Path, said: dict[str, Any], message: str
):
    with pytest.raises(RefusedWeights, match=message):
        checked(unseen(), tmp_path, **said)


def test_a_row_of_a_seen_hand_wants_weights_that_have_seen_it(tmp_path: Path):
    with pytest.raises(RefusedWeights, match=r"was not trained on two_jaws, only on barrett\."):
        checked(seen(), tmp_path)
    with pytest.raises(RefusedWeights, match=r"trained on another two_jaws than .*two_jaws; test"):
        checked(seen(), tmp_path, **OWN, hand_hashes={"two_jaws": "0" * 64})


def test_weights_of_another_body_are_refused(tmp_path: Path):
    for said in ({}, {"hand_body": "0" * 64}):
        with pytest.raises(RefusedWeights, match="is for another hand than this two_jaws"):
            checked(regressed(), tmp_path, **OWN, **said)


@pytest.mark.parametrize("method", [unseen(), seen(), regressed()])
@pytest.mark.parametrize(
    "said",
    [
        {"train_objects": ["banana", "contactdb+apple@0.9"]},
        {"validation_objects": ["apple"]},
        {"object_hashes": "renamed"},
    ],
    ids=["train", "validation", "renamed"],
)
def test_weights_that_have_seen_an_object_of_the_table_are_refused(
    tmp_path: Path, method: Method, said: dict[str, Any]
):
    if said.get("object_hashes"):
        said = {"object_hashes": {"fruit": object_hash("apple")}}
    with pytest.raises(RefusedWeights, match=r"has seen objects of this table in training: apple"):
        checked(method, tmp_path, **said)


def test_objects_that_are_not_there_are_left_to_others_to_tell():
    found = table_objects("apple", "no_such_thing", "banana")
    assert found.names == {"apple", "banana"}
    assert found.hashes[object_hash("apple")] == "apple"


def test_objects_by_path_are_known_by_name_and_content(tmp_path: Path):
    from gdg.folders import OBJECTS

    folder = OBJECTS.find("apple").path
    mesh = next(path for path in folder.iterdir() if path.suffix in (".obj", ".stl", ".ply"))
    copy = tmp_path / f"fruit{mesh.suffix}"
    copy.write_bytes(mesh.read_bytes())
    assert table_objects(str(folder)).names == {"apple"}
    assert table_objects(str(copy)).hashes == {object_hash("apple"): "fruit"}
