"""A scan: Hounsfield units on a lattice that lies somewhere in the patient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Int16, Num

from naris.errors import ScanError

LPS = "LPS"
_SINGULAR = 1e-6


@dataclass(frozen=True, eq=False)
class Volume:
    """Values on a lattice of voxels, and where in the patient each of them is.

    Attributes:
        hu: (ni, nj, nk) Hounsfield units of voxel centres. In a DICOM series i counts columns, j rows and k slices;
            for other files the order is that of the file.
        frame_T_index: (4, 4) takes (i, j, k, 1) to mm in `frame`. Its columns need not be at right angles: the slices
            of a tilted gantry are sheared against each other.
        frame: of the patient, `LPS`.

    Raises:
        ScanError: if the lattice is flat, not finite, or not three-dimensional.
    """

    hu: Int16[np.ndarray, "ni nj nk"] | Float32[np.ndarray, "ni nj nk"]
    frame_T_index: Float[np.ndarray, "4 4"]
    frame: str = LPS

    def __post_init__(self) -> None:
        matrix = np.array(self.frame_T_index, dtype=np.float64)
        if self.hu.ndim != 3 or min(self.hu.shape) < 1:
            raise ScanError("a scan with three axes", f"one of shape {self.hu.shape}", "give a whole volume")
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ScanError("a finite affine matrix 4×4 from voxels to mm", f"{matrix.tolist()}", "repair the header")
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if lengths.min() <= 0 or abs(np.linalg.det(matrix[:3, :3] / lengths)) < _SINGULAR:
            raise ScanError(
                "three axes that span space", f"the axes {matrix[:3, :3].T.tolist()}", "repair the header of the scan"
            )
        matrix.setflags(write=False)
        object.__setattr__(self, "frame_T_index", matrix)

    @property
    def shape(self) -> tuple[int, int, int]:
        ni, nj, nk = self.hu.shape
        return ni, nj, nk

    @cached_property
    def spacing_mm(self) -> Float[np.ndarray, "3"]:
        """From one voxel to the next along each axis of the lattice."""
        return np.asarray(np.linalg.norm(self.frame_T_index[:3, :3], axis=0))

    @cached_property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Unit directions of the axes of the lattice in the patient, one in each column."""
        return np.asarray(self.frame_T_index[:3, :3] / self.spacing_mm)

    @cached_property
    def skew_deg(self) -> float:
        """How far the axes are from right angles, 0 for a box."""
        cosines = np.abs((self.axes.T @ self.axes)[np.triu_indices(3, 1)])
        return float(np.rad2deg(np.arcsin(np.clip(cosines.max(), 0, 1))))

    @cached_property
    def bounds_mm(self) -> Float[np.ndarray, "2 3"]:
        """Low and high corner of the box in the patient that holds every voxel centre."""
        corners = np.stack(np.meshgrid(*[(0, n - 1) for n in self.shape], indexing="ij"), axis=-1).reshape(-1, 3)
        points = self.points_mm(corners)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def points_mm(self, index: Num[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Where lattice coordinates (..., 3) lie in the patient, mm; whole numbers are voxel centres."""
        return np.asarray(np.asarray(index) @ self.frame_T_index[:3, :3].T + self.frame_T_index[:3, 3])

    def index(self, points_mm: Num[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """The reverse of `points_mm`: lattice coordinates (..., 3), fractions between voxel centres."""
        back = np.linalg.inv(self.frame_T_index[:3, :3])
        return np.asarray((np.asarray(points_mm) - self.frame_T_index[:3, 3]) @ back.T)
