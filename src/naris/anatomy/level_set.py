"""From a field that is positive in the lumen to one closed surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int32
from scipy import ndimage

from naris.errors import InputError

Field = Float[np.ndarray, "nx ny nz"]
_REACH_MM = 1.5
_SIGMA_MM = 0.5


def softened(field: Field, spacing_mm: float) -> Field:
    """The field without films of air or tissue that are too thin for the grid, and with softer edges."""
    return ndimage.gaussian_filter(np.clip(field, -_REACH_MM, _REACH_MM), _SIGMA_MM / spacing_mm, truncate=3.0)


def only_lumen(field: Field) -> Field:
    """The field with its largest connected lumen alone, without tissue that floats in it.

    Raises:
        InputError: if there is no lumen.
    """
    field = field.copy()
    for axis in range(3):
        border = np.moveaxis(field, axis, 0)
        border[[0, -1]] = np.minimum(border[[0, -1]], -1.0)
    wrong_air = _all_but_largest(field > 0)
    field[wrong_air] = -np.abs(field[wrong_air]) - 1e-3
    wrong_tissue = _all_but_largest(field <= 0)
    field[wrong_tissue] = np.abs(field[wrong_tissue]) + 1e-3
    return field


def _all_but_largest(mask: Bool[np.ndarray, "nx ny nz"]) -> Bool[np.ndarray, "nx ny nz"]:
    labels, count = ndimage.label(mask)
    if count == 0:
        raise InputError("a lumen", "no air at all", "widen the passages")
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return mask & (labels != sizes.argmax())


def surface(
    field: Field, origin_mm: Float[np.ndarray, "3"], spacing_mm: float
) -> tuple[Float[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
    """Vertices in mm and faces, wound counter-clockwise seen from the tissue (marching cubes; Lewiner et al. 2003)."""
    from skimage.measure import marching_cubes

    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(spacing_mm,) * 3, gradient_direction="descent")
    vertices = vertices.astype(np.float64) + origin_mm
    if _signed_volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    return vertices, np.ascontiguousarray(faces, dtype=np.int32)


def taubin(
    vertices: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"], steps: int, pass_band: tuple[float, float]
) -> Float[np.ndarray, "v 3"]:
    """Smooths without shrinking: alternating steps of the umbrella operator (Taubin 1995)."""
    from scipy.sparse import coo_matrix

    a = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
    b = np.concatenate([faces[:, 1], faces[:, 2], faces[:, 0]])
    ones = np.ones(2 * len(a), dtype=np.float64)
    link = coo_matrix((ones, (np.r_[a, b], np.r_[b, a])), shape=(len(vertices),) * 2).tocsr()
    link.data[:] = 1.0
    degree = np.asarray(link.sum(axis=1))
    for i in range(2 * steps):
        vertices = vertices + pass_band[i % 2] * (link @ vertices / degree - vertices)
    return vertices


def _signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
