"""A mean anatomy and the ways in which others differ from it, in the form that a registration needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from naris.anatomy.gaussian_process import GaussianProcess
from naris.anatomy.shape_model import ShapeModel
from naris.core.anatomy import Anatomy

MODES = 60
"""Of a Gaussian process at its usual scale they hold some nine tenths of the variance of a nose."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Shapes `mean + Σ weight · mode`; a weight is in standard deviations, so that its prior is N(0, 1).

    Make it with `of_shape_model` or `of_gaussian_process`.

    Attributes:
        mean: the anatomy at weights 0.
        by_vertex_mm: (V, 3, K) how each vertex moves at one standard deviation of each mode, the greatest first.
    """

    mean: Anatomy
    by_vertex_mm: Float32[np.ndarray, "v 3 k"]

    def __len__(self) -> int:
        return self.by_vertex_mm.shape[2]

    def vertices_mm(self, weights: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """Where the vertices are, in the frame of the mean."""
        if not weights.any():
            return self.mean.vertices_mm
        return np.asarray(self.mean.vertices_mm + self.by_vertex_mm @ weights.astype(np.float32), dtype=np.float64)

    def first(self, count: int) -> Modes:
        """The same with so many modes at most."""
        return Modes(self.mean, np.ascontiguousarray(self.by_vertex_mm[..., :count]))

    @property
    def off_mm(self) -> float:
        """Standard deviation of the walls of all shapes across the wall of the mean, over all vertices."""
        across = np.einsum("vak,va->vk", self.by_vertex_mm, self.mean.vertex_normals.astype(np.float32))
        return float(np.sqrt(np.square(across).sum(axis=1).mean()))


def of_shape_model(model: ShapeModel, most: int | None = None) -> Modes:
    """Those of a model built from patients; all of them where no number is said."""
    return Modes(model.mean, np.ascontiguousarray(model.modes_mm[:most].transpose(1, 2, 0)))


def of_gaussian_process(process: GaussianProcess, most: int = MODES) -> Modes:
    """The greatest modes of a Gaussian process around one anatomy, as many as are asked for at most.

    They add up as they are (Lüthi et al. 2018, section 3.3). `GaussianProcess.draw` walks a steep displacement in
    several steps and lets the nasal cycle come to it; neither is in the modes.
    """
    parts = [(axis, mode) for axis, mode in _by_size(process)[:most]]
    by_vertex = np.zeros((len(process.anatomy.vertices_mm), 3, len(parts)), np.float32)
    for k, (axis, mode) in enumerate(parts):
        by_vertex[:, axis, k] = process.basis[min(axis, 1)][:, mode]
    return Modes(process.anatomy, by_vertex)


def _by_size(process: GaussianProcess) -> list[tuple[int, int]]:
    """The axis and number of every mode, the greatest mean square over the vertices first."""
    sizes = [np.square(basis).mean(axis=0) for basis in process.basis]
    every = [(float(size), axis, mode) for axis in range(3) for mode, size in enumerate(sizes[min(axis, 1)])]
    return [(axis, mode) for _, axis, mode in sorted(every, key=lambda one: -one[0])]
