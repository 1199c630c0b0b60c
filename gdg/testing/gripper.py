"""A two-jaw gripper as a hand folder, simple enough to predict by hand."""

from __future__ import annotations

from pathlib import Path

#: Distance of each jaw's inner face from the middle when the gripper is open, metres.
OPEN_M = 0.05

URDF = """\
<robot name="two_jaws">
  <link name="base">
    <inertial>
      <mass value="0.3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
    <collision>
      <origin xyz="0 0 -0.02"/><geometry><box size="0.04 0.14 0.02"/></geometry>
    </collision>
  </link>
  <link name="palm">
    <collision>
      <origin xyz="0 0 -0.005"/><geometry><box size="0.04 0.12 0.01"/></geometry>
    </collision>
  </link>
  <link name="left">
    <collision>
      <origin xyz="0 0.005 0.035"/><geometry><box size="0.03 0.01 0.06"/></geometry>
    </collision>
  </link>
  <link name="right">
    <collision>
      <origin xyz="0 -0.005 0.035"/><geometry><box size="0.03 0.01 0.06"/></geometry>
    </collision>
  </link>
  <joint name="palm_fixed" type="fixed"><parent link="base"/><child link="palm"/></joint>
  <joint name="close" type="prismatic">
    <parent link="palm"/><child link="left"/>
    <origin xyz="0 0.05 0"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.05" effort="100" velocity="1"/>
  </joint>
  <joint name="close_right" type="prismatic">
    <parent link="palm"/><child link="right"/>
    <origin xyz="0 -0.05 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.05" effort="100" velocity="1"/>
    <mimic joint="close"/>
  </joint>
</robot>
"""

MANIFEST = """\
name: two_jaws
title: Two parallel jaws
urdf: two_jaws.urdf
root_link: base
palm: {link: palm, normal: [0, 0, 1], center: [0, 0, 0]}
joints: [close]
open: {close: 0.0}
closed: {close: 0.05}
contact_regions:
  left:
    - [[-0.015, 0, 0.01], [0.015, 0, 0.01], [0.015, 0, 0.06], [-0.015, 0, 0.06]]
  right:
    - [[-0.015, 0, 0.06], [0.015, 0, 0.06], [0.015, 0, 0.01], [-0.015, 0, 0.01]]
drives:
  default: {stiffness: 2000, damping: 100, force_limit: 20}
provenance: {source: written for gdg.testing, licence: Apache-2.0}
"""


def write_gripper(folder: Path) -> Path:
    """Writes the hand folder ``two_jaws`` into ``folder`` and returns its path.

    The palm looks along +z from z = 0; the jaws reach from z = 5 to 65 mm and close along y. The
    one actuated joint ``close`` (metres) moves both inner faces to y = ±(``OPEN_M`` − close).
    """
    target = folder / "two_jaws"
    target.mkdir(parents=True, exist_ok=True)
    (target / "two_jaws.urdf").write_text(URDF, encoding="utf-8")
    (target / "hand.yaml").write_text(MANIFEST, encoding="utf-8")
    return target
