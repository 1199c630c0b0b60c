"""The two-jaw gripper of the conformance kit, under the name by which tests import it."""

from __future__ import annotations

from gdg.testing.gripper import MANIFEST, OPEN_M, URDF, write_gripper

__all__ = ["MANIFEST", "OPEN_M", "URDF", "write_gripper"]
