"""A table-top scene goes from the command line to what is planned, tested, stored and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from gdg_plugins.simulator_sapien.simulator import SapienSimulator

from gdg.data.grasps import load_grasps
from gdg.errors import GdgError
from gdg.penetration.table import hand_height
from gdg.pipeline.fingerprint import fingerprint, plan_fingerprint
from gdg.pipeline.grasp import run_grasp
from gdg.pipeline.jobs import EvalJob, GraspJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.report.scene import build_scene
from gdg.scenes.above import approach_height

PLAIN = ("object=cube_small", "n=8", "picture=false", "report=false")


@pytest.fixture
def config(configs, tmp_path: Path) -> Callable:
    return lambda *words: configs(GraspJob, *PLAIN, f"out={tmp_path / 'run'}", *words)[0]


@pytest.fixture
def pair(config) -> Pair:
    return Pair.load(config("scene=tabletop", "planner.batch=16"))


def test_the_scene_names_the_protocol_unless_one_is_given(config):
    assert config().job.protocol == "dro-2024"
    assert config("scene=tabletop").job.protocol == "tabletop-lift"
    assert config("scene=tabletop", "protocol=mine.yaml").job.protocol == "mine.yaml"


def test_each_scene_of_a_sweep_has_its_own_protocol(configs):
    swept = configs(EvalJob, "object=cube_small", "scene=free,tabletop")
    assert [c.job.protocol for c in swept] == ["dro-2024", "tabletop-lift"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("scene=tabletop", "protocol=dro-2024"), "write protocol=tabletop-lift"),
        (("protocol=tabletop-lift",), "write scene=tabletop"),
        (("scene=tabletop", "scene_pose=6"), "has the resting poses 0"),
    ],
)
def test_a_scene_and_a_protocol_that_do_not_match_are_refused(config, words, said: str):
    with pytest.raises(GdgError, match=said):
        Pair.load(config(*words))


def test_a_resting_pose_without_a_table_is_refused(config):
    with pytest.raises(GdgError, match=r"scene_pose=3: counts poses on a table.* scene=tabletop"):
        config("scene_pose=3")


def test_an_unknown_scene_is_refused(config):
    with pytest.raises(GdgError, match="scene"):
        config("scene=shelf")


def test_a_scene_changes_the_fingerprints_and_its_absence_does_not(config):
    free, table = config(), config("scene=tabletop", "protocol=dro-2024")
    other = config("scene=tabletop", "protocol=dro-2024", "scene_pose=1")
    for of in (fingerprint, plan_fingerprint):
        assert len({of(free), of(table), of(other)}) == 3
        assert of(free) == of(config("scene=free", "scene_pose=0"))


def test_what_is_planned_stays_above_the_table_and_says_so(pair: Pair):
    grasps = pair.plan(16, generator_for(0), contact_maps=False)
    assert len(grasps) > 0
    assert grasps.scene is not None
    assert grasps.scene == pair.obj.scene
    assert grasps.scene.table.normal == (0.0, 0.0, 1.0)
    q, table = pair.hand.q_of(grasps), grasps.scene.table
    assert hand_height(pair.hand, table, q).min() >= -1e-5
    assert approach_height(pair.hand, table, q).min() >= -1e-5
    assert {"hand in the table", "way to the grasp through the table"} <= set(
        grasps.provenance["rejected"]
    )


def test_a_run_tells_the_simulator_of_the_table_and_stores_it(
    config, calls, monkeypatch: pytest.MonkeyPatch
):
    tables, answer = [], SapienSimulator.simulate

    def simulate(self, hand, obj, grasps, protocol, progress=None):
        tables.append((obj.table, protocol.name))
        return answer(self, hand, obj, grasps, protocol, progress)

    monkeypatch.setattr(SapienSimulator, "simulate", simulate)
    run = run_grasp(config("scene=tabletop", "planner.batch=16"))
    stored = load_grasps(run.folder / "grasps.json")
    assert stored.scene is not None
    assert stored.scene == run.grasps.scene
    assert tables == [(stored.scene.table, "tabletop-lift")]


def test_the_picture_stands_on_the_table(pair: Pair):
    grasps = pair.plan(16, generator_for(0), contact_maps=False)
    scene = build_scene(pair.hand, pair.obj, grasps, 500, 500)
    assert scene.table is not None
    assert scene.object_mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-5)
    assert np.abs(scene.table.vertices[:, 2]).max() == 0.0
    assert (scene.eyes[..., 2] > 0).all()
    for index in range(len(grasps)):
        for link, mesh in scene.link_meshes.items():
            T = scene.Ts_object_link[index, link]
            assert (mesh.vertices @ T[2, :3] + T[2, 3]).min() > -1e-4
    free = build_scene(pair.hand, Pair.load(pair.config.model_copy(update={
        "job": pair.job.model_copy(update={"scene": "free", "protocol": "dro-2024"})
    })).obj, grasps, 500, 500)  # fmt: skip
    assert free.table is None
    torch.testing.assert_close(
        torch.from_numpy(free.Ts_object_link), pair.hand.link_poses(pair.hand.q_of(grasps)),
        rtol=0, atol=1e-6,
    )  # fmt: skip
