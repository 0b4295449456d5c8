"""Surfaces and views that the tests of the renderer share."""

from __future__ import annotations

import numpy as np
import trimesh

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.pose import Pose

UP = np.array([0.0, 0.0, 1.0])


def sphere(radius_mm: float = 10.0, subdivisions: int = 4, frame: str = "LPS") -> Anatomy:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_mm)
    return Anatomy(np.asarray(mesh.vertices), np.asarray(mesh.faces).astype(np.int32), frame, "sphere", "made up")


def pod(frame: str = "LPS") -> Anatomy:
    """A long cavity with lumps, not symmetric in any axis."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    p = np.asarray(mesh.vertices)
    lumps = 1 + 0.25 * np.sin(5 * p[:, :1] + 1) * np.sin(4 * p[:, 1:2]) + 0.15 * np.cos(6 * p[:, 2:] + p[:, :1])
    points = p * lumps * np.array([8.0, 25.0, 12.0])
    return Anatomy(points, np.asarray(mesh.faces).astype(np.int32), frame, "pod", "made up")


def views(n: int, seed: int = 0, frame: str = "LPS") -> Pose:
    """Cameras around the middle that look anywhere."""
    rng = np.random.default_rng(seed)
    return Pose.look(rng.uniform(-2, 2, (n, 3)), rng.normal(size=(n, 3)), UP, frame, rng.uniform(-3, 3, n))


def picture(width: int = 64, height: int = 48, fov_deg: float = 70.0) -> Intrinsics:
    return Intrinsics.from_vertical_fov(width, height, fov_deg)


def ring(frame: str = "LPS") -> Anatomy:
    """A tube that closes on itself: through its near wall, the far side is seen from outside."""
    mesh = trimesh.creation.torus(15.0, 5.0, major_sections=48, minor_sections=24)
    return Anatomy(np.asarray(mesh.vertices), np.asarray(mesh.faces).astype(np.int32), frame, "ring", "made up")


def views_in_ring(n: int, seed: int = 0, frame: str = "LPS") -> Pose:
    """Cameras inside the tube that look across the ring."""
    rng = np.random.default_rng(seed)
    position = np.array([15.0, 0.0, 0.0]) + rng.uniform(-2, 2, (n, 3))
    return Pose.look(position, np.array([-1.0, 0.0, 0.0]) + rng.normal(0, 0.3, (n, 3)), UP, frame)
