"""The arrays of a surface in the form that both engines read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from naris.core.anatomy import Anatomy


class Geometry(NamedTuple):
    """A surface in single precision.

    Attributes:
        vertices_mm: (V, 3).
        vertex_normals: (V, 3) unit, outward.
        faces: (F, 3) int32.
        face_normals: (F, 3) unit, outward; 0 for a face without area.
    """

    vertices_mm: np.ndarray
    vertex_normals: np.ndarray
    faces: np.ndarray
    face_normals: np.ndarray


def geometry_of(anatomy: Anatomy) -> Geometry:
    """The arrays of an anatomy."""
    a, b, c = (anatomy.vertices_mm[anatomy.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0, length, 1)
    return Geometry(
        np.ascontiguousarray(anatomy.vertices_mm, np.float32),
        np.ascontiguousarray(anatomy.vertex_normals, np.float32),
        np.ascontiguousarray(anatomy.faces, np.int32),
        np.ascontiguousarray(normal, np.float32),
    )
