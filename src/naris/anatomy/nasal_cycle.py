"""The nasal cycle: the mucosa of one side swells while that of the other shrinks, and no slit closes.

Every vertex moves along a normal by no more than a share of the half-width of the air before it, or of the tissue
behind it, up to the wall on the other side. Normals and limits are evened out over neighbours, the limits downwards
only: so that walls do not meet, and a wall does not fold where normals run into each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array, csr_array

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy, Between

_MARCH_MM = np.arange(0.25, 4.01, 0.25)
_MOST = 0.4  # of the half-width of the air before a wall, or of the tissue behind it
_SIDE_MM = 0.7  # beside the middle, where one side's mucosa becomes the other's
_ENDS_MM = 5.0  # over which it fades at nostrils and choanae
_SWELLING_RINGS, _NORMAL_RINGS, _LIMIT_RINGS = 8, 3, 2


@dataclass(frozen=True, eq=False)
class NasalCycle:
    """How the mucosa of an anatomy swells; make one with `of`.

    Attributes:
        towards: (V, 3) unit vectors out of the lumen, the normals evened out.
        swelling_mm: (V,) how far each vertex moves into the lumen at one standard deviation of the cycle; the other way
            on the other side.
        most_in_mm, most_out_mm: (V,) how far a vertex may move into the lumen or out of it, so that no slit closes and
            no wall is worn through.
    """

    towards: Float[np.ndarray, "v 3"]
    swelling_mm: Float[np.ndarray, "v"]
    most_in_mm: Float[np.ndarray, "v"]
    most_out_mm: Float[np.ndarray, "v"]

    @staticmethod
    def of(anatomy: Anatomy, sd_mm: float, middle_mm: float | None) -> NasalCycle:
        """The cycle of an anatomy; there is none without landmarks of both sides or where air lies between walls.

        Args:
            anatomy: with its landmarks.
            sd_mm: standard deviation of the swelling.
            middle_mm: the x of the plane between the two sides, None where it is not known.
        """
        marks = anatomy.landmarks_mm
        ends = [f"{side}.{name}" for side in ("left", "right") for name in ("nostril", "choana")]
        known = middle_mm is not None and all(name in marks for name in ends)
        if middle_mm is None or not known or sd_mm == 0 or isinstance(anatomy.airspace, Between):
            none = np.zeros(len(anatomy.vertices_mm))
            return NasalCycle(anatomy.vertex_normals, none, none, none)
        neighbours = _neighbours(anatomy)
        share = (neighbours / neighbours.sum(axis=1)[:, None]).tocsr()
        towards = _over(anatomy.vertex_normals, share, _NORMAL_RINGS)
        towards = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        x, y = anatomy.vertices_mm[:, 0] - middle_mm, anatomy.vertices_mm[:, 1]
        front = max(float(marks[f"{side}.nostril"][1]) for side in ("left", "right"))
        behind = min(float(marks[f"{side}.choana"][1]) for side in ("left", "right"))
        within = np.clip(np.minimum(y - front, behind - y) / _ENDS_MM, 0, 1)
        swelling = _over(sd_mm * within * np.tanh(x / _SIDE_MM), share, _SWELLING_RINGS)
        most_in, most_out = (
            _over(_least(_MOST * room, neighbours, _LIMIT_RINGS), share, _LIMIT_RINGS) for room in _rooms(anatomy)
        )
        return NasalCycle(towards, swelling, most_in, most_out)

    def shift_mm(self, size: float) -> Float[np.ndarray, "v 3"]:
        """How vertices move at so many standard deviations of the cycle, the left swelling where it is above 0."""
        swollen = np.clip(size * self.swelling_mm, -self.most_out_mm, self.most_in_mm)
        return -swollen[:, None] * self.towards


def _rooms(anatomy: Anatomy) -> tuple[Float[np.ndarray, "v"], Float[np.ndarray, "v"]]:
    """The half-width of the air before each vertex and of the tissue behind it, up to the next wall."""
    distance, normals = signed_distance(anatomy), anatomy.vertex_normals
    march = _MARCH_MM[:, None, None]
    air, tissue = (
        way * distance(anatomy.vertices_mm - way * march * normals) for way in (1.0, -1.0)
    )  # (steps, V), above 0 up to the wall
    air, tissue = (np.where(np.minimum.accumulate(one, axis=0) > 0, one, 0.0).max(axis=0) for one in (air, tissue))
    return air, tissue


def _neighbours(anatomy: Anatomy) -> csr_array:
    """(V, V) 1 where two vertices share an edge or are the same."""
    count = len(anatomy.vertices_mm)
    edges = np.concatenate([anatomy.faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    pairs = np.unique(np.concatenate([edges, edges[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)]), axis=0)
    return coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr()


def _over(field: Float[np.ndarray, "v *n"], share: csr_array, rings: int) -> Float[np.ndarray, "v *n"]:
    """A field on the vertices with its mean over each and its neighbours taken so many times."""
    for _ in range(rings):
        field = share @ field
    return field


def _least(field: Float[np.ndarray, "v"], neighbours: csr_array, rings: int) -> Float[np.ndarray, "v"]:
    """The least of a field within so many rings, so that its mean over as many is at most the field itself."""
    for _ in range(rings):
        field = np.minimum.reduceat(field[neighbours.indices], neighbours.indptr[:-1])
    return field
