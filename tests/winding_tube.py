"""Tubes: the smallest lumens with a passage, four slabs and walls at a known distance; one winds, one widens."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from naris.core.anatomy import Anatomy, Passage, SlabRegions

RADIUS_MM = 5.0
SLABS = SlabRegions("slabs", ("one", "two", "three", "four"), "LPS", 1, (-20.0, 0.0, 20.0))


def centre_line() -> np.ndarray:
    """(N, 3) points 0.5 mm apart from y = −40 to y = 40, rising and falling by 6 mm."""
    y = np.linspace(-40, 40, 4001)
    line = np.stack([2 * np.cos(y / 20), y, 6 * np.sin(y / 18)], axis=1)
    reach = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return np.stack([np.interp(np.arange(0, reach[-1], 0.5), reach, line[:, k]) for k in range(3)], axis=1)


@cache
def winding_tube() -> Anatomy:
    """The tube with its centre line as the passage `main`."""
    line = centre_line()
    return _tube(line, np.full(len(line), RADIUS_MM), "a winding tube")


@cache
def widening_tube() -> Anatomy:
    """A straight tube along y whose radius grows from 3 to 9 mm, with its axis as the passage `main`."""
    line = np.linspace([0.0, -40, 0], [0.0, 40, 0], 161)
    return _tube(line, np.linspace(3.0, 9.0, len(line)), "a widening tube")


def _tube(line: np.ndarray, radius_mm: np.ndarray, name: str) -> Anatomy:
    step = 1.0
    axes = [np.arange(low, high, step) for low, high in ((-12, 13), (-51, 52), (-14, 15))]
    far, nearest = cKDTree(line).query(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    vertices, faces, _, _ = marching_cubes(
        radius_mm[nearest] - far, 0.0, spacing=(step,) * 3, gradient_direction="descent"
    )
    vertices = vertices + [axis[0] for axis in axes]
    volume = np.einsum("ij,ij->", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]]))
    faces = faces if volume > 0 else faces[:, ::-1]
    return Anatomy(
        vertices, np.ascontiguousarray(faces, np.int32), "LPS", name, "made up",
        regions={"slabs": SLABS}, passages=(Passage("main", line, radius_mm),),
    )  # fmt: skip
