"""A surface prepared for the search of most likely matches: its triangles in a tree that knows their normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from naris.anatomy.triangles import TriangleIndex, index_triangles
from naris.core.anatomy import Anatomy
from naris.core.kept import Kept
from naris.errors import SurfaceError
from naris.register.likely_point.match import Tree
from naris.render.sources import sources_of

_kept: Kept[Surface] = Kept(4)


@dataclass(frozen=True, eq=False)
class Surface:
    """Make it with `surface_of` or `surface_from`.

    Attributes:
        frame: of its coordinates.
        tree: the triangles in the order of `TriangleIndex`, with normals, for the compiled search.
        face_ids: (F,) the face that each of them was.
    """

    frame: str
    tree: Tree
    face_ids: Int[np.ndarray, "f"]


def surface_of(anatomy: Anatomy) -> Surface:
    """The walls of an anatomy; the last few are kept, by its digest."""
    return _kept.get(anatomy.digest, lambda: surface_from(anatomy.vertices_mm, anatomy.faces, anatomy.frame))


def surface_from(vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], frame: str) -> Surface:
    """Any triangles, closed or not; normals are to the side from which corners run anticlockwise.

    Raises:
        SurfaceError: if there is no triangle, or one names a vertex that there is not.
    """
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices_mm):
        raise SurfaceError(
            f"triangles of {len(vertices_mm)} vertices", f"{len(faces)} with others", "check the faces of the surface"
        )
    index = index_triangles(vertices_mm, faces.astype(np.int32))
    a, b, c = np.moveaxis(index.corners_mm, 1, 0)
    normals = np.cross(b - a, c - a)
    # A triangle without area has no normal: 0 is at right angles to everything.
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    tree = Tree(index.corners_mm, index.leaf_start, index.boxes_mm, normals, _cones(index, normals), _sources())
    return Surface(frame, tree, index.face_ids)


def _cones(index: TriangleIndex, normals: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "m 5"]:
    """Of every box of the tree the mean normal, and cosine and sine of the angle that all its normals lie within."""
    levels, step = [], 1
    while step < len(index.leaf_start):
        start = index.leaf_start[:-1:step]
        axis = np.add.reduceat(normals, start)
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        axis = np.where(length > 1e-9, axis / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
        owner = np.repeat(np.arange(len(start)), np.diff(start, append=len(normals)))
        cosine = np.clip(np.minimum.reduceat((normals * axis[owner]).sum(axis=1), start) - 1e-9, -1.0, 1.0)
        levels.append(np.column_stack([axis, cosine, np.sqrt(1 - cosine**2)]))
        step *= 2
    return np.ascontiguousarray(np.vstack(levels[::-1]))


def _sources() -> np.ndarray:
    return sources_of("naris.register.likely_point.match", "naris.anatomy.kernels")
