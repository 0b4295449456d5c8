"""Other libraries that register clouds, where they are installed: small_gicp and Open3D.

They register points to points, so the surface is given to them as a dense cloud with normals. Each runs with what it is
known for: small_gicp as GICP (Segal, Haehnel and Thrun 2009; its covariances from ten neighbours) and from points to
planes (Chen and Medioni 1992), Open3D from points to planes with Tukey's weights.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from naris.core.anatomy import Anatomy
from naris.core.kept import Kept
from naris.errors import MachineError

GICP, PLANES, OPEN3D = "small_gicp", "small_gicp_planes", "Open3D"
LIBRARIES = (GICP, PLANES, OPEN3D)
NOT_INSTALLED = "not installed"
_EXTRA = {GICP: "small-gicp", PLANES: "small-gicp", OPEN3D: "open3d"}
_TARGET_POINTS = 100_000
_REACHES_MM = (5.0, 2.5)
_KIND = {GICP: "GICP", PLANES: "PLANE_ICP"}
_STEPS = 50
_NEIGHBOURS = 10

Align = Callable[[Float[np.ndarray, "4 4"]], Float[np.ndarray, "4 4"]]
"""From where a cloud begins to where a library ends, both from the cloud to the surface."""

OfCloud = Callable[[Float[np.ndarray, "n 3"]], Align]
"""What aligns a cloud in mm, prepared once for all its starts."""

_kept: Kept[OfCloud] = Kept(4)


@dataclass(frozen=True, eq=False)
class Target:
    """A surface as points (M, 3) in mm with unit normals (M, 3)."""

    points: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]


def target_of(
    vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], count: int, rng: np.random.Generator
) -> Target:
    """So many points all over a surface, evenly by area."""
    a, b, c = np.moveaxis(vertices_mm[faces], 1, 0)
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    chosen = rng.choice(len(faces), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)
    points = np.einsum("nc,cnk->nk", weights, np.stack([a[chosen], b[chosen], c[chosen]]))
    return Target(points, cross[chosen] / area[chosen, None])


def library_for(name: str, anatomy: Anatomy) -> OfCloud:
    """A library made ready for the walls of an anatomy as 100,000 points, matches up to 5, then 2.5 mm away.

    The last few are kept, by the digest of the anatomy.

    Raises:
        MachineError: if it is not installed.
    """
    return _kept.get((name, anatomy.digest), lambda: _ready(name, anatomy))


def _ready(name: str, anatomy: Anatomy) -> OfCloud:
    target = target_of(anatomy.vertices_mm, anatomy.faces, _TARGET_POINTS, np.random.default_rng(0))
    ready = aligner(name, target, _REACHES_MM)
    if isinstance(ready, str):
        raise MachineError(f"the library of the method {name.lower()}", ready, f"pip install 'naris[{_EXTRA[name]}]'")
    return ready


def aligner(name: str, target: Target, reaches_mm: Sequence[float]) -> OfCloud | str:
    """A library made ready for a surface; or why it cannot be.

    Args:
        name: one of `LIBRARIES`.
        target: the surface.
        reaches_mm: how far matches may lie apart, one pass after the other.
    """
    absent = missing(name)
    if absent is not None:
        return absent
    return _open3d(target, reaches_mm) if name == OPEN3D else _small_gicp(target, reaches_mm, _KIND[name])


def missing(name: str) -> str | None:
    """Why a library cannot be used here; None if it can."""
    try:
        importlib.import_module("open3d" if name == OPEN3D else "small_gicp")
    except ImportError as error:
        # A missing library of the system is told otherwise than a package that is not there.
        return NOT_INSTALLED if isinstance(error, ModuleNotFoundError) else f"cannot start here ({str(error)[:120]})"
    return None


def _small_gicp(target: Target, reaches_mm: Sequence[float], kind: str) -> OfCloud:
    import small_gicp

    def prepared(points: np.ndarray) -> tuple[Any, Any]:
        cloud = small_gicp.PointCloud(points)
        tree = small_gicp.KdTree(cloud)
        small_gicp.estimate_normals_covariances(cloud, tree, _NEIGHBOURS)
        return cloud, tree

    wall, wall_tree = prepared(target.points)

    def of_cloud(points: np.ndarray) -> Align:
        cloud, _ = prepared(points)

        def align(pose: np.ndarray) -> np.ndarray:
            for reach in reaches_mm:
                result = small_gicp.align(wall, cloud, wall_tree, pose, kind, reach, 1, _STEPS)
                pose = np.asarray(result.T_target_source)
            return _proper(pose)

        return align

    return of_cloud


def _open3d(target: Target, reaches_mm: Sequence[float]) -> OfCloud:
    import open3d

    registration, as_points = open3d.pipelines.registration, open3d.utility.Vector3dVector
    wall = open3d.geometry.PointCloud(as_points(target.points))
    wall.normals = as_points(target.normals)
    stop = registration.ICPConvergenceCriteria(max_iteration=_STEPS)

    def of_cloud(points: np.ndarray) -> Align:
        cloud = open3d.geometry.PointCloud(as_points(points))

        def align(pose: np.ndarray) -> np.ndarray:
            for reach in reaches_mm:
                to_planes = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(reach))
                result = registration.registration_icp(cloud, wall, reach, pose, to_planes, stop)
                pose = np.asarray(result.transformation)
            return _proper(pose)

        return align

    return of_cloud


def _proper(pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The nearest rotation: libraries return theirs with what rounding left of it."""
    u, _, w = np.linalg.svd(pose[:3, :3])
    cleaned = pose.copy()
    cleaned[:3, :3] = u @ w
    return cleaned
