"""A small odd hand, an object and three grasps of it, for the tests of reports."""

from __future__ import annotations

import math

import pytest
import torch
from grasp_samples import make_verdict

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.hands.hand import load_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.registry import get_registry

URDF = """\
<robot name="paddles">
  <link name="base"><collision><geometry><box size="0.06 0.1 0.01"/></geometry></collision></link>
  <link name="paddle">
    <visual>
      <origin xyz="0 0 0.03"/><geometry><cylinder radius="0.008" length="0.06"/></geometry>
    </visual>
    <collision><origin xyz="0 0 0.03"/><geometry><box size="0.02 0.01 0.06"/></geometry></collision>
  </link>
  <link name="tip">
    <visual><geometry><mesh filename="lost.stl"/></geometry></visual>
    <collision><geometry><sphere radius="0.01"/></geometry></collision>
  </link>
  <joint name="&lt;&amp;finger" type="revolute">
    <parent link="base"/><child link="paddle"/><origin xyz="0 0.05 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="paddle"/><child link="tip"/><origin xyz="0 0 0.06"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.02" effort="5" velocity="1"/>
  </joint>
</robot>
"""
MANIFEST = """\
name: paddles
urdf: paddles.urdf
root_link: base
palm: {link: base, normal: [0, 0, 1], center: [0, 0, 0.005]}
joints: ["<&finger", slide]
contact_regions:
  paddle:
    - [[-0.01, -0.005, 0], [0.01, -0.005, 0], [0.01, -0.005, 0.06], [-0.01, -0.005, 0.06]]
provenance: {source: written for the test, licence: Apache-2.0}
"""


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> HandModel:
    folder = tmp_path_factory.mktemp("hands") / "paddles"
    folder.mkdir()
    (folder / "paddles.urdf").write_text(URDF, encoding="utf-8")
    (folder / "hand.yaml").write_text(MANIFEST, encoding="utf-8")
    record = get_registry().find("hand-model", "pytorch-kinematics")
    return record.load()(record.options(), load_hand(folder), torch.device("cpu"))


@pytest.fixture(scope="module")
def obj() -> ObjectModel:
    return find_object("cup")


def verdict(success: bool, moved_m: float = 0.0012) -> Verdict:
    return make_verdict(
        success,
        displacement_m=(0.0001, 0.0002, moved_m, 0.0003, 0.0, 0.0001),
        drift_m=0.0004,
        penetration_start_mm=0.8,
        penetration_end_mm=0.1,
        free_displacement_m=0.127,
        shift_successes=(success, success, True),
    )


@pytest.fixture(scope="module")
def grasps(hand: HandModel, obj: ObjectModel) -> GraspSet:
    poses = torch.eye(4).repeat(3, 1, 1)
    poses[:, 2, 3] = torch.tensor([-0.06, -0.07, -0.08])
    height = obj.points[:, 2]
    return GraspSet(
        hand=hand.hand.name,
        object_name=obj.name,
        joint_names=tuple(hand.joint_names),
        root_link="base",
        poses=poses,
        joints=torch.tensor([[0.1, 0.0], [0.2, 0.01], [0.4, 0.02]]),
        energies={"total": torch.tensor([1.5, 2.5, math.nan])},
        status=("converged",) * 3,
        contact_values=((height - height.min()) / (height.max() - height.min())).repeat(3, 1),
        verdicts=(verdict(True), verdict(False), verdict(True, 0.003)),
        provenance={"seed": 3},
    )
