"""Rotations as the published layouts store them. All in float64.

Three forms of the same matrix R (R turns root-link vectors into the object frame):

- *6-D* (MultiDex): the first two **columns** of R, one after the other. The authors' reader makes
  both orthogonal symmetrically, and so do we. (gdg's own q holds the first two rows.)
- *sxyz* (DexGraspNet, transforms3d's default): R = Rz(c) Ry(b) Rx(a).
- *XYZ* (D(R,O)): R = Rx(a) Ry(b) Rz(c).
"""

from __future__ import annotations

import numpy as np


def rotation_from_columns(columns: np.ndarray) -> np.ndarray:
    """(…, 6) to (…, 3, 3); not finite where the two columns are zero or parallel."""
    with np.errstate(invalid="ignore", divide="ignore"):
        first, second = _unit(columns[..., :3]), _unit(columns[..., 3:])
        middle, across = _unit(first + second), _unit(first - second)
        first, second = _unit(middle + across), _unit(middle - across)
        return np.stack((first, second, np.cross(first, second)), axis=-1)


def columns_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """(…, 3, 3) to (…, 6)."""
    return np.concatenate((rotation[..., :, 0], rotation[..., :, 1]), axis=-1)


def rotation_from_sxyz(angles: np.ndarray) -> np.ndarray:
    """(…, 3) angles about the fixed axes x, y, z, in that order, to (…, 3, 3)."""
    about_x, about_y, about_z = (_about(axis, angles[..., axis]) for axis in range(3))
    return about_z @ about_y @ about_x


def rotation_from_moving_xyz(angles: np.ndarray) -> np.ndarray:
    """(…, 3) angles about the moving axes x, y, z, in that order, to (…, 3, 3)."""
    about_x, about_y, about_z = (_about(axis, angles[..., axis]) for axis in range(3))
    return about_x @ about_y @ about_z


def sxyz_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """(…, 3, 3) to (…, 3) angles that give the same matrix, at the poles (b = ±90°) too.

    The third angle is taken from the matrix with the first one undone, which keeps the matrix
    exact to rounding near the poles, where the angles themselves are ill-determined.
    """
    r = nearest_rotation(rotation)
    first = np.arctan2(r[..., 2, 1], r[..., 2, 2])
    sine, cosine = np.sin(first), np.cos(first)
    second = np.arctan2(-r[..., 2, 0], np.hypot(r[..., 2, 1], r[..., 2, 2]))
    third = np.arctan2(
        sine * r[..., 0, 2] - cosine * r[..., 0, 1], cosine * r[..., 1, 1] - sine * r[..., 1, 2]
    )
    return np.stack((first, second, third), axis=-1)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation nearest to a matrix that is one up to rounding."""
    u, _, vt = np.linalg.svd(np.asarray(matrix, np.float64))
    return u @ vt


def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """(…, 3, 3) to (…, 4) unit quaternions wxyz, w ≥ 0."""
    r = nearest_rotation(rotation)
    # the symmetric matrix whose largest eigenvector is the quaternion (Bar-Itzhack 2000)
    trace = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    k = np.empty((*r.shape[:-2], 4, 4))
    k[..., 1:, 1:] = r + np.swapaxes(r, -1, -2) - trace[..., None, None] * np.eye(3)
    k[..., 0, 0] = trace
    for index, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        k[..., 0, index + 1] = k[..., index + 1, 0] = r[..., i, j] - r[..., j, i]
    quaternion = np.linalg.eigh(k)[1][..., :, -1]
    return np.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def rotation_from_quaternion(quat_wxyz: np.ndarray) -> np.ndarray:
    """(…, 4) to (…, 3, 3); the quaternions are normalised first."""
    w, x, y, z = np.moveaxis(_unit(np.asarray(quat_wxyz, np.float64)), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def poses_from(translation: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """(…, 4, 4) from (…, 3) and (…, 3, 3)."""
    poses = np.zeros((*translation.shape[:-1], 4, 4))
    poses[..., :3, :3], poses[..., :3, 3], poses[..., 3, 3] = rotation, translation, 1.0
    return poses


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotations about one coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.zeros((*np.shape(angle), 3, 3))
    matrix[..., axis, axis] = 1.0
    matrix[..., first, first] = matrix[..., second, second] = np.cos(angle)
    matrix[..., second, first] = np.sin(angle)
    matrix[..., first, second] = -np.sin(angle)
    return matrix


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
