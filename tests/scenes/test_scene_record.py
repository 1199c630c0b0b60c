"""What an object stands on is stored with its grasps, and comes back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dataset_samples import FACTS, sample_grasps
from hypothesis import given, settings
from hypothesis import strategies as st

from gdg.data.dataset import read_shard, stream_grasps, write_shard
from gdg.data.grasps import load_grasps
from gdg.data.scene import TableScene
from gdg.data.shards import read_info
from gdg.data.table import Table
from gdg.errors import GdgError

SCENE = TableScene(Table((0.6, 0.0, 0.8), -0.031), 2, 0.125)

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(directions, st.floats(-0.5, 0.5))
@settings(max_examples=20)
def test_a_scene_comes_back_from_its_plain_values(direction: tuple[float, ...], offset: float):
    x, y, z = (np.array(direction) / np.linalg.norm(direction)).tolist()
    scene = TableScene(Table((x, y, z), offset), 1, 0.5)
    assert TableScene.from_dict(json.loads(json.dumps(scene.as_dict()))) == scene
    # in the table's frame z is the height above it
    p = np.array([0.03, -0.02, 0.05])
    height = (scene.T_table_object @ np.append(p, 1.0))[2]
    assert height == pytest.approx(p @ np.array([x, y, z]) - offset, abs=1e-9)


def test_grasps_json_keeps_the_scene(tmp_path: Path):
    grasps = replace(sample_grasps(), scene=SCENE)
    grasps.save(tmp_path / "grasps.json")
    assert load_grasps(tmp_path / "grasps.json").scene == SCENE
    tree = json.loads((tmp_path / "grasps.json").read_text())["scene"]
    assert tree["name"] == "tabletop"
    assert tree["table"] == {"normal": [0.6, 0.0, 0.8], "offset": -0.031}
    assert np.array(tree["T_table_object"]).shape == (4, 4)


def test_a_file_without_a_scene_is_written_and_read_as_ever(tmp_path: Path):
    sample_grasps().save(tmp_path / "grasps.json")
    assert "scene" not in json.loads((tmp_path / "grasps.json").read_text())
    assert load_grasps(tmp_path / "grasps.json").scene is None


def test_a_shard_keeps_the_scene(tmp_path: Path):
    path = write_shard(tmp_path, "k", replace(sample_grasps(), scene=SCENE), FACTS)
    assert read_info(path).scene == SCENE
    assert read_shard(path).scene == SCENE
    assert all(batch.scene == SCENE for batch in stream_grasps(tmp_path))
    free = write_shard(tmp_path, "free", sample_grasps(), FACTS)
    assert read_shard(free).scene is None


def test_selected_grasps_keep_the_scene():
    assert replace(sample_grasps(), scene=SCENE).select([0]).scene == SCENE


@pytest.mark.parametrize(
    "scene",
    [
        {"name": "cave"},
        {"name": "tabletop", "pose": 0, "probability": 1.0},
        {"name": "tabletop", "pose": 0, "probability": 1.0,
         "table": {"normal": [0, 0, 5], "offset": 0}},
    ],
)  # fmt: skip
def test_a_scene_that_is_none_is_told(tmp_path: Path, scene: dict):
    sample_grasps().save(tmp_path / "grasps.json")
    tree = json.loads((tmp_path / "grasps.json").read_text())
    (tmp_path / "grasps.json").write_text(json.dumps({**tree, "scene": scene}))
    with pytest.raises(GdgError, match="is no readable grasp file"):
        load_grasps(tmp_path / "grasps.json")
