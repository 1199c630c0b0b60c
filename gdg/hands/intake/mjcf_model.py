"""A compiled MuJoCo model, read by names and poses."""

from __future__ import annotations

import importlib
import math
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from gdg.errors import GdgError
from gdg.hands.urdf import MAX_NAME

FREE, BALL, SLIDE, HINGE = "free", "ball", "slide", "hinge"
#: Joint types by MuJoCo's number for them.
JOINT_TYPES = (FREE, BALL, SLIDE, HINGE)


#: Arrays of a compiled model and the size up to which their numbers are taken seriously.
MOST = dict.fromkeys(
    (
        "body_pos", "body_ipos", "body_mass", "body_inertia", "geom_pos", "geom_size", "jnt_pos",
        "mesh_vert", "qpos0", "qpos_spring",
    ), 1e6,
) | dict.fromkeys(
    (
        "actuator_biasprm", "actuator_ctrlrange", "actuator_forcerange", "actuator_gainprm",
        "actuator_gear", "body_iquat", "body_quat", "dof_damping", "eq_data", "geom_quat",
        "jnt_actfrcrange", "jnt_axis", "jnt_range", "jnt_stiffness", "tendon_range", "wrap_prm",
    ), 1e12,
)  # fmt: skip


class MjcfModel:
    """What the intake asks of a compiled model, whatever the version of MuJoCo.

    Attributes:
        path: the description, for messages.
        raw: MuJoCo's model.
        engine: the module ``mujoco``.
        body_count, actuator_count: how many it has, the world among the bodies.
        body_names: a name for each body, unique and printable; ``world`` is the first.
        joint_names: a name for each joint, unique and printable.
    """

    def __init__(self, path: Path, raw: Any):
        self.path = path
        self.raw = raw
        self.engine = load_mujoco(path)
        self.body_count = int(raw.nbody)
        self.actuator_count = len(raw.actuator_trntype)
        self.body_names = _names(raw.body, raw.nbody, lambda index: f"body_{index}")
        self.joint_names = _names(
            raw.joint, raw.njnt, lambda j: f"{self.body_names[raw.jnt_bodyid[j]]}_joint"
        )

    # -- bodies

    def parent(self, body: int) -> int:
        """The body that a body hangs on."""
        return int(self.raw.body_parentid[body])

    def subtree(self, body: int) -> Iterator[int]:
        """A body and all below it, parents before children."""
        kept = {body}
        for b in range(self.body_count):
            if b == body or (b != 0 and self.parent(b) in kept):
                if b != body and body == 0 and self._floats(b):
                    continue
                kept.add(b)
                yield b

    def _floats(self, body: int) -> bool:
        return any(self.joint_type(j) == FREE for j in self.joints_of(body))

    def body_pose(self, body: int) -> np.ndarray:
        """``T_parent_body`` with the body's joints at their reference."""
        return pose(self.raw.body_pos[body], self.raw.body_quat[body])

    def inertial(self, body: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass (kg), frame of the principal axes in the body's frame, moments (kg m²)."""
        frame = pose(self.raw.body_ipos[body], self.raw.body_iquat[body])
        return float(self.raw.body_mass[body]), frame, np.array(self.raw.body_inertia[body])

    def has_shapes(self, body: int) -> bool:
        """Whether a body or one below it has a geom."""
        return any(self.raw.body_geomnum[b] > 0 for b in self.subtree(body))

    def excluded_pairs(self, links: dict[int, str]) -> Iterator[tuple[str, str]]:
        """Pairs of links that the model excludes from contact; ``links``: body -> link."""
        for signature in np.asarray(self.raw.exclude_signature, np.int64).ravel():
            first, second = int(signature) >> 16, int(signature) & 0xFFFF
            if first in links and second in links and first != second:
                yield links[first], links[second]

    # -- joints

    def joints_of(self, body: int) -> list[int]:
        """The joints between a body and its parent, in the order in which they move it."""
        first = int(self.raw.body_jntadr[body])
        return list(range(first, first + int(self.raw.body_jntnum[body]))) if first >= 0 else []

    def joints_below(self, body: int) -> list[int]:
        """All joints of a body and of those below it."""
        return [j for b in self.subtree(body) for j in self.joints_of(b)]

    def joint_type(self, joint: int) -> str:
        """``free``, ``ball``, ``slide`` or ``hinge``."""
        return JOINT_TYPES[int(self.raw.jnt_type[joint])]

    def joint_frame(self, joint: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Unit axis and anchor in the body's frame, and the value at which the body is in place."""
        ref = float(self.raw.qpos0[self.raw.jnt_qposadr[joint]])
        return np.array(self.raw.jnt_axis[joint]), np.array(self.raw.jnt_pos[joint]), ref

    def joint_range(self, joint: int) -> tuple[float, float]:
        """Limits, rad or m; NaN where there are none."""
        if not self.raw.jnt_limited[joint]:
            return math.nan, math.nan
        lower, upper = self.raw.jnt_range[joint]
        return float(lower), float(upper)

    def joint_force(self, joint: int) -> float:
        """Most force or torque that actuators may put on a joint; 0 where the model says none."""
        if not self.raw.jnt_actfrclimited[joint]:
            return 0.0
        return float(np.abs(self.raw.jnt_actfrcrange[joint]).max())

    def hinged_to_world(self, body: int) -> bool:
        """Whether a body hangs on the world by a hinge or slide."""
        return any(self.joint_type(j) in (HINGE, SLIDE) for j in self.joints_of(body))

    # -- tendons and actuators

    def tendon_joints(self, tendon: int) -> dict[int, float]:
        """Joint -> coefficient of a fixed tendon; empty for a spatial one."""
        first, count = int(self.raw.tendon_adr[tendon]), int(self.raw.tendon_num[tendon])
        span = range(first, first + count)
        if not all(among(self.raw.wrap_type[w], self.engine.mjtWrap.mjWRAP_JOINT) for w in span):
            return {}
        return {int(self.raw.wrap_objid[w]): float(self.raw.wrap_prm[w]) for w in span}

    def actuated_joint(self, actuator: int) -> int | None:
        """The joint on which an actuator acts directly, if it does."""
        kinds = self.engine.mjtTrn.mjTRN_JOINT, self.engine.mjtTrn.mjTRN_JOINTINPARENT
        if not among(self.raw.actuator_trntype[actuator], *kinds):
            return None
        return int(self.raw.actuator_trnid[actuator][0])

    def actuated_tendon(self, actuator: int) -> int | None:
        """The tendon that an actuator pulls, if it does."""
        if not among(self.raw.actuator_trntype[actuator], self.engine.mjtTrn.mjTRN_TENDON):
            return None
        return int(self.raw.actuator_trnid[actuator][0])

    def joints_of_actuator(self, actuator: int) -> list[int]:
        """The joints that an actuator moves, directly or by a fixed tendon."""
        joint, tendon = self.actuated_joint(actuator), self.actuated_tendon(actuator)
        if joint is not None:
            return [joint]
        return list(self.tendon_joints(tendon)) if tendon is not None else []

    def driven_joints(self) -> set[int]:
        """All joints that some actuator moves, directly or by a fixed tendon."""
        return {j for a in range(self.actuator_count) for j in self.joints_of_actuator(a)}


def load_mujoco(path: Path) -> Any:
    """The module ``mujoco``, for reading the description at ``path``.

    Raises:
        GdgError: it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise GdgError(
            f"{path}: is MJCF, which gdg reads with MuJoCo: pip install 'gdg[mujoco]'"
        ) from error


def check_numbers(path: Path, raw: Any) -> None:
    """Raises a ``GdgError`` where a compiled model holds numbers that no hand's would."""
    for name, most in MOST.items():
        values = np.asarray(getattr(raw, name), np.float64)
        if not (np.abs(values) < most).all():  # false for NaN, too
            what = name.replace("_", " ")
            raise GdgError(f"{path}: a number of '{what}' is not finite, or absurdly large.")


def pose(position: Any, quat_wxyz: Any = None) -> np.ndarray:
    """A 4x4 pose from a position and a unit quaternion."""
    made = np.eye(4)
    if quat_wxyz is not None:
        made = trimesh.transformations.quaternion_matrix(np.asarray(quat_wxyz, np.float64))
    made[:3, 3] = position
    return made


def among(value: Any, *kinds: Any) -> bool:
    """Whether a number in a model's arrays is one of some enumeration's values.

    By integers: MuJoCo's enumerations and numpy's integers are not equal from either side.
    """
    return int(value) in map(int, kinds)


def _names(view: Any, count: int, stand_in: Any) -> list[str]:
    """The names of a kind of objects; ``stand_in`` names those whose own can't be written."""
    names = [view(index).name for index in range(count)]
    for index, name in enumerate(names):
        # by half: names of links and joints that are added end in more letters
        if not name.strip() or not name.isprintable() or len(name) > MAX_NAME // 2:
            names[index] = free_name(stand_in(index), names)
    return names


def free_name(wanted: str, taken: Collection[str]) -> str:
    """The wanted name, with the first number that makes it unlike the names taken."""
    name, number = wanted, 2
    while name in taken:
        name, number = f"{wanted}_{number}", number + 1
    return name
