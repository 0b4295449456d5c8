"""Other libraries that register clouds, on the same clouds from the same starts: small_gicp and Open3D.

They register points to points, so the surface is given to them as a dense cloud with normals. Each runs with what it is
known for: small_gicp as GICP (its covariances from ten neighbours) and from points to planes, Open3D from points to
planes with Tukey's weights.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

GICP, PLANES, OPEN3D = "small_gicp", "small_gicp_planes", "Open3D"
PEERS = (GICP, PLANES, OPEN3D)
NOT_INSTALLED = "not installed"
_KIND = {GICP: "GICP", PLANES: "PLANE_ICP"}
_STEPS = 50
_NEIGHBOURS = 10

Align = Callable[[Float[np.ndarray, "4 4"]], Float[np.ndarray, "4 4"]]
"""From where a cloud begins to where a peer ends, both from the cloud to the surface."""


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


def aligner(name: str, target: Target, reaches_mm: Sequence[float]) -> Callable[[np.ndarray], Align] | str:
    """A peer made ready for a surface: for a cloud (N, 3) it gives what aligns it; or why it cannot.

    Args:
        name: one of `PEERS`.
        target: the surface.
        reaches_mm: how far matches may lie apart, one pass after the other.
    """
    absent = missing(name)
    if absent is not None:
        return absent
    return _open3d(target, reaches_mm) if name == OPEN3D else _small_gicp(target, reaches_mm, _KIND[name])


def missing(name: str) -> str | None:
    """Why a peer cannot be measured here; None if it can."""
    try:
        importlib.import_module("open3d" if name == OPEN3D else "small_gicp")
    except ImportError as error:
        # A missing library of the system is told otherwise than a package that is not there.
        return NOT_INSTALLED if isinstance(error, ModuleNotFoundError) else f"cannot start here ({str(error)[:120]})"
    return None


def _small_gicp(target: Target, reaches_mm: Sequence[float], kind: str) -> Callable[[np.ndarray], Align]:
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
            return pose

        return align

    return of_cloud


def _open3d(target: Target, reaches_mm: Sequence[float]) -> Callable[[np.ndarray], Align]:
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
            return pose

        return align

    return of_cloud
