"""Closed surfaces with known answers."""

import numpy as np
import trimesh

from naris.core.anatomy import Anatomy


def anatomy_of(mesh: trimesh.Trimesh, frame: str = "LPS") -> Anatomy:
    return Anatomy(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int32), frame, "test", "a test")


def box(size=(40.0, 60.0, 30.0), centre=(0.0, 0.0, 0.0)) -> Anatomy:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(centre)
    return anatomy_of(mesh)


def sphere(radius_mm=20.0, subdivisions=4) -> Anatomy:
    return anatomy_of(trimesh.creation.icosphere(subdivisions, radius_mm))


def torus(ring_mm=20.0, tube_mm=6.0) -> Anatomy:
    return anatomy_of(trimesh.creation.torus(ring_mm, tube_mm, major_sections=96, minor_sections=48))


def tube(length_mm=60.0, radius_mm=4.0) -> Anatomy:
    """Along y, closed at both ends."""
    mesh = trimesh.creation.cylinder(radius_mm, length_mm, sections=48)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return anatomy_of(mesh)


def box_distance(points, size=(40.0, 60.0, 30.0)):
    """Positive inside."""
    over = np.abs(points) - np.asarray(size) / 2
    return -(np.linalg.norm(np.maximum(over, 0), axis=-1) + np.minimum(over.max(axis=-1), 0))
