"""An anatomy whose vertices went elsewhere, with everything that is known in it carried along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from naris.anatomy.centreline import STEP_MM, resample
from naris.anatomy.triangles import index_triangles
from naris.core.anatomy import Anatomy, Between, GridRegions, Passage, RegionSet
from naris.errors import PoseError

NEAREST = 8
_LEAST_MM = 0.1
_MARGIN_NODES = 3
_SPACING_MM = 1.0
_COARSE_MM = 2.0


@dataclass(frozen=True, eq=False)
class Mover:
    """Moves points as the nearest vertices go, the nearer the more (inverse squared distances; D. Shepard 1968).

    Attributes:
        tree: of the vertices where they begin.
        shift_mm: (V, 3) where each goes, seen from there.
    """

    tree: cKDTree
    shift_mm: Float[np.ndarray, "v 3"]

    @staticmethod
    def between(begin_mm: Float[np.ndarray, "v 3"], end_mm: Float[np.ndarray, "v 3"]) -> Mover:
        return Mover(cKDTree(begin_mm), end_mm - begin_mm)

    def __call__(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Where points (..., 3) go."""
        points = np.asarray(points_mm, dtype=np.float64)
        flat = points.reshape(-1, 3)
        far, nearest = self.tree.query(flat, k=NEAREST)
        weight = np.maximum(far, _LEAST_MM) ** -2
        shift = np.einsum("nk,nkj->nj", weight / weight.sum(axis=1, keepdims=True), self.shift_mm[nearest])
        return (flat + shift).reshape(points.shape)


def carried_along(anatomy: Anatomy, vertices_mm: Float[np.ndarray, "v 3"], name: str, source: str) -> Anatomy:
    """The anatomy with its vertices there; landmarks, passages and regions go with them (slabs become a grid).

    Raises:
        PoseError: if a passage would leave the lumen: the vertices have passed through each other.
    """
    there = Mover.between(anatomy.vertices_mm, vertices_mm)
    margin_mm = _MARGIN_NODES * _SPACING_MM
    low, high = vertices_mm.min(axis=0) - margin_mm, vertices_mm.max(axis=0) + margin_mm
    back = _Smooth.of(Mover.between(vertices_mm, anatomy.vertices_mm), low, high)
    index = index_triangles(vertices_mm, anatomy.faces)
    passages = []
    for passage in anatomy.passages:
        points = resample(there(passage.points_mm), STEP_MM)
        wound = index.winding(points) >= 1
        if not (~wound if isinstance(anatomy.airspace, Between) else wound).all():
            raise PoseError(f"the passage {passage.name} inside the lumen", "points of it in the wall", "move it less")
        passages.append(Passage(passage.name, points, index.closest(points).distance_mm))
    return Anatomy(
        vertices_mm,
        anatomy.faces,
        anatomy.frame,
        name,
        source,
        regions={key: _carried(regions, back, vertices_mm) for key, regions in anatomy.regions.items()},
        passages=tuple(passages),
        landmarks_mm={key: there(point[None])[0] for key, point in anatomy.landmarks_mm.items()},
        airspace=anatomy.airspace,
    )


@dataclass(frozen=True, eq=False)
class _Smooth:
    """What a mover does, known at the nodes of a coarse grid and linear in between.

    Neighbouring vertices go much the same way, so that hardly a label at a border differs (a test says how many);
    asking the mover at every node of a region set takes several times as long.
    """

    shift_mm: Float[np.ndarray, "nx ny nz 3"]
    origin_mm: Float[np.ndarray, "3"]

    @staticmethod
    def of(mover: Mover, low_mm: Float[np.ndarray, "3"], high_mm: Float[np.ndarray, "3"]) -> _Smooth:
        axes = [np.arange(low_mm[k], high_mm[k] + _COARSE_MM, _COARSE_MM) for k in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return _Smooth(mover(nodes) - nodes, low_mm)

    def at(self, axes: list[Float[np.ndarray, "_"]]) -> Float[np.ndarray, "nx ny nz 3"]:
        """The shifts at the nodes of a grid, beyond the coarse one as at its end."""
        shift = self.shift_mm
        for k, axis in enumerate(axes):
            place = np.clip((axis - self.origin_mm[k]) / _COARSE_MM, 0, shift.shape[k] - 1)
            low = np.minimum(place.astype(np.int64), shift.shape[k] - 2)
            share = np.expand_dims(place - low, [j for j in range(4) if j != k])
            shift = np.take(shift, low, axis=k) * (1 - share) + np.take(shift, low + 1, axis=k) * share
        return shift


def _carried(regions: RegionSet, back: _Smooth, vertices_mm: Float[np.ndarray, "v 3"]) -> GridRegions:
    """A grid of labels at the new place: each node has the label of where it came from."""
    step = regions.spacing_mm if isinstance(regions, GridRegions) else _SPACING_MM
    low = np.floor(vertices_mm.min(axis=0) / step) - _MARGIN_NODES
    count = np.ceil(vertices_mm.max(axis=0) / step) + _MARGIN_NODES - low + 1
    axes = [step * (low[k] + np.arange(int(count[k]))) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    labels = regions.label(nodes + back.at(axes)).astype(np.int8)
    return GridRegions(regions.name, regions.names, regions.frame, labels, step * low, step)
