"""Rigid transforms with named frames: `target_T_source` takes points of `source` to `target`."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.errors import PoseError

CAMERA = "camera"
_ORTHONORMAL_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class Pose:
    """One rigid transform, or a batch of them, with the names of both frames.

    Attributes:
        matrix: (*batch, 4, 4) float64, translation in mm.
        target: the frame that points come out in, e.g. `LPS` or `mean`.
        source: the frame that points go in from, e.g. `camera` (x right, y down, z forward).

    Raises:
        PoseError: if an entry is not finite or a rotation is not orthonormal and right-handed.
    """

    matrix: Float[np.ndarray, "*batch 4 4"]
    target: str
    source: str

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, dtype=np.float64)
        if matrix.ndim < 2 or matrix.shape[-2:] != (4, 4):
            raise PoseError("a pose of shape (..., 4, 4)", f"shape {matrix.shape}", "give homogeneous matrices")
        if not np.isfinite(matrix).all():
            raise PoseError("a pose of finite numbers", "NaN or infinity", "remove the broken poses")
        rotation = matrix[..., :3, :3]
        slack = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(initial=0.0)
        bottom = np.abs(matrix[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])).max(initial=0.0)
        if max(slack, bottom) > _ORTHONORMAL_TOLERANCE or (np.linalg.det(rotation) < 0).any():
            raise PoseError(
                "a rigid transform (orthonormal, right-handed, last row 0 0 0 1)",
                f"one that is off by {max(slack, bottom):.2g}" if max(slack, bottom) > 1e-4 else "a reflection",
                "check for scaling, transposition or a mirrored axis",
            )
        matrix = matrix.copy()
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)

    @staticmethod
    def identity(frame: str, source: str | None = None) -> Pose:
        """The transform that changes nothing (between two names of the same place)."""
        return Pose(np.eye(4), frame, source or frame)

    @staticmethod
    def of(
        rotation: Float[np.ndarray, "*batch 3 3"],
        translation_mm: Float[np.ndarray, "*batch 3"],
        target: str,
        source: str,
    ) -> Pose:
        """From a rotation and the position of the source's origin in the target, in mm."""
        rotation, translation_mm = np.asarray(rotation, float), np.asarray(translation_mm, float)
        matrix = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation_mm.shape[:-1]), 4, 4))
        matrix[..., :3, :3] = rotation
        matrix[..., :3, 3] = translation_mm
        matrix[..., 3, 3] = 1.0
        return Pose(matrix, target, source)

    @staticmethod
    def look(
        position_mm: Float[np.ndarray, "*batch 3"],
        forward: Float[np.ndarray, "*batch 3"],
        up: Float[np.ndarray, "*#batch 3"],
        target: str,
        roll_rad: Float[np.ndarray, "*#batch"] | float = 0.0,
    ) -> Pose:
        """The camera at `position_mm` that looks along `forward` with `up` upwards in the picture.

        `roll_rad` then turns the camera clockwise about its optical axis (the picture turns the
        other way). Where `forward` is parallel to `up`, another axis stands in for `up`.

        Raises:
            PoseError: if a direction is not finite or has no length.
        """
        forward, up, position_mm = (np.asarray(v, dtype=np.float64) for v in (forward, up, position_mm))
        length = np.linalg.norm(forward, axis=-1, keepdims=True)
        if not np.isfinite(forward).all() or (length < 1e-12).any():
            raise PoseError("a viewing direction of finite length", "NaN or zero", "check the pose file")
        z = forward / length
        shape = np.broadcast_shapes(z.shape, up.shape, position_mm.shape)
        z, up = np.broadcast_to(z, shape), np.broadcast_to(up, shape)
        x = np.cross(z, up)
        degenerate = np.linalg.norm(x, axis=-1, keepdims=True) < 1e-6 * np.linalg.norm(up, axis=-1, keepdims=True)
        spare = np.where(np.abs(z[..., :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
        x = np.where(degenerate, np.cross(z, spare), x)
        x = x / np.linalg.norm(x, axis=-1, keepdims=True)
        y = np.cross(z, x)
        roll = np.asarray(roll_rad, dtype=np.float64)[..., None]
        x, y = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x
        return Pose.of(np.stack([x, y, z], axis=-1), np.broadcast_to(position_mm, shape), target, CAMERA)

    @staticmethod
    def exp(twist: Float[np.ndarray, "*batch 6"], target: str, source: str) -> Pose:
        """Of a twist (translation part in mm, then rotation vector in rad): the SE(3) exponential."""
        twist = np.asarray(twist, dtype=np.float64)
        rho, phi = twist[..., :3], twist[..., 3:]
        angle = np.linalg.norm(phi, axis=-1)[..., None, None]
        hat = _hat(phi)
        small = angle < 1e-6
        safe = np.where(small, 1.0, angle)
        a = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
        b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
        c = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
        rotation = np.eye(3) + a * hat + b * hat @ hat
        left_jacobian = np.eye(3) + b * hat + c * hat @ hat
        return Pose.of(rotation, (left_jacobian @ rho[..., None])[..., 0], target, source)

    def log(self) -> Float[np.ndarray, "*batch 6"]:
        """The twist whose exponential this is: translation part in mm, rotation vector in rad."""
        phi = rotation_vector(self.rotation)
        angle = np.linalg.norm(phi, axis=-1)[..., None, None]
        hat = _hat(phi)
        small = angle < 1e-4
        safe = np.where(small, 1.0, angle)
        half = safe / 2
        tail = np.where(small, 1 / 12 + angle**2 / 720, (1 - half * np.cos(half) / np.sin(half)) / safe**2)
        inverse_jacobian = np.eye(3) - hat / 2 + tail * hat @ hat
        rho = (inverse_jacobian @ self.position_mm[..., None])[..., 0]
        return np.concatenate([rho, phi], axis=-1)

    @property
    def rotation(self) -> Float[np.ndarray, "*batch 3 3"]:
        return self.matrix[..., :3, :3]

    @property
    def position_mm(self) -> Float[np.ndarray, "*batch 3"]:
        """Where the origin of `source` lies in `target`; for a camera pose, the camera's centre."""
        return self.matrix[..., :3, 3]

    @property
    def forward(self) -> Float[np.ndarray, "*batch 3"]:
        """The z axis of `source` in `target`; for a camera pose, the viewing direction."""
        return self.matrix[..., :3, 2]

    @property
    def shape(self) -> tuple[int, ...]:
        return self.matrix.shape[:-2]

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single pose has no length")
        return self.shape[0]

    def __getitem__(self, index: object) -> Pose:
        return Pose(self.matrix[index], self.target, self.source)  # type: ignore[call-overload]

    def __matmul__(self, other: Pose) -> Pose:
        """`a_T_b @ b_T_c` is `a_T_c`; frames that do not meet are refused."""
        if self.source != other.target:
            raise PoseError(
                f"a transform into {self.source!r} on the right of {self.target}_T_{self.source}",
                f"{other.target}_T_{other.source}",
                "invert or reorder one of them",
            )
        return Pose(self.matrix @ other.matrix, self.target, other.source)

    def inverse(self) -> Pose:
        transposed = np.swapaxes(self.rotation, -1, -2)
        return Pose.of(transposed, -(transposed @ self.position_mm[..., None])[..., 0], self.source, self.target)

    def apply(self, points_mm: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*out 3"]:
        """Points of `source` in `target`: (..., N, 3) against a batch (...), or any shape for one pose."""
        if not self.shape:
            return np.asarray(points_mm) @ self.rotation.T + self.position_mm
        return np.asarray(points_mm) @ np.swapaxes(self.rotation, -1, -2) + self.position_mm[..., None, :]

    def reshape(self, *shape: int) -> Pose:
        return Pose(self.matrix.reshape(*shape, 4, 4), self.target, self.source)


def stack(poses: Sequence[Pose]) -> Pose:
    """Poses between the same two frames as one batch along a new first axis."""
    if not poses:
        raise PoseError("at least one pose to stack", "none", "give a pose")
    frames = {(pose.target, pose.source) for pose in poses}
    if len(frames) > 1:
        raise PoseError("poses between the same two frames", f"{sorted(frames)}", "stack them apart")
    return Pose(np.stack([pose.matrix for pose in poses]), poses[0].target, poses[0].source)


def rotation_vector(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Axis times angle (rad, at most pi) of a rotation matrix, stable at 0 and at pi."""
    from scipy.spatial.transform import Rotation

    flat = np.asarray(rotation, dtype=np.float64).reshape(-1, 3, 3)
    return Rotation.from_matrix(flat).as_rotvec().reshape(*rotation.shape[:-2], 3)


def distance(a: Pose, b: Pose) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """How far two camera poses are apart: between centres in mm, and the angle between them in rad."""
    if (a.target, a.source) != (b.target, b.source):
        raise PoseError(f"two poses {a.target}_T_{a.source}", f"{b.target}_T_{b.source}", "bring them to one frame")
    relative = np.swapaxes(a.rotation, -1, -2) @ b.rotation
    angle_rad = np.linalg.norm(rotation_vector(relative), axis=-1)
    return np.asarray(np.linalg.norm(a.position_mm - b.position_mm, axis=-1)), np.asarray(angle_rad)


def _hat(v: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    zero = np.zeros_like(v[..., 0])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return rows.reshape(*v.shape[:-1], 3, 3)


def fingerprints(poses: Pose) -> list[str]:
    """Eight letters a pose (N,), the same for the same pose: to see whether two sets of views share some.

    Two of a thousand different poses share theirs with a chance of one in ten thousand.
    """
    rounded = np.round(poses.matrix.reshape(-1, 16), 6) + 0.0  # no −0
    return [hashlib.sha256(np.ascontiguousarray(row).tobytes()).hexdigest()[:8] for row in rounded]
