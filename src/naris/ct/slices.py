"""Where the slices of a series lie: sorted, checked, and told as one affine matrix or not at all.

The position and orientation of every slice are taken from its own header (DICOM PS3.3, C.7.6.2.1.1: Image Position and
Image Orientation (Patient)); slice numbers and thicknesses are not trusted. The slice normal is n = r × c. Slices are
sorted by n · p. What then remains is told in numbers: gaps along n, and the way that slices wander across it, which a
tilted gantry makes in equal steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from naris.errors import ScanError

FEWEST = 3
SAME_DIRECTION_RAD = 1e-3  # headers round direction cosines to six digits or fewer
_SAME_SPACING = 1e-3  # share
SAME_PLACE_MM = 0.01
_EVEN, _EVEN_MM = 0.02, 0.03  # slices less off their even places, in steps or mm, are there: positions are rounded
_ASIDE_MM = 0.1
_UPRIGHT_DEG = 0.1


@dataclass(frozen=True, eq=False)
class Plane:
    """One slice as its header tells.

    Attributes:
        position_mm: (3,) centre of the first pixel in the patient, LPS.
        along_row, along_column: (3,) unit directions in which the column index i and the row index j rise.
        spacing_mm: from pixel to pixel along a row (i) and along a column (j).
        shape: pixels of a row and of a column (ni, nj).
    """

    position_mm: Float[np.ndarray, "3"]
    along_row: Float[np.ndarray, "3"]
    along_column: Float[np.ndarray, "3"]
    spacing_mm: tuple[float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        numbers = np.concatenate([self.position_mm, self.along_row, self.along_column, self.spacing_mm])
        if not np.isfinite(numbers).all() or min(self.spacing_mm) <= 0:
            raise ScanError(
                "finite positions and directions and a spacing above 0 in every slice",
                f"position {_told(self.position_mm)}, spacing {self.spacing_mm} mm",
                "export the series again",
            )
        lengths = [float(np.linalg.norm(one)) for one in (self.along_row, self.along_column)]
        cosine = float(self.along_row @ self.along_column)
        if max(abs(length - 1) for length in lengths) > SAME_DIRECTION_RAD or abs(cosine) > SAME_DIRECTION_RAD:
            raise ScanError(
                "rows and columns of length 1 at right angles in Image Orientation (Patient)",
                f"{_told(self.along_row)} and {_told(self.along_column)}",
                "export the series again",
            )

    @property
    def normal(self) -> Float[np.ndarray, "3"]:
        """r × c, of unit length."""
        normal = np.cross(self.along_row, self.along_column)
        return np.asarray(normal / np.linalg.norm(normal))

    def turned_rad(self, other: Plane) -> float:
        """How far the rows or the columns of another plane, whichever more, are turned from those of this one."""
        apart = max(
            float(np.linalg.norm(self.along_row - other.along_row)),
            float(np.linalg.norm(self.along_column - other.along_column)),
        )
        return 2 * float(np.arcsin(min(apart / 2, 1)))


@dataclass(frozen=True, eq=False)
class Stack:
    """How slices lie behind each other.

    Attributes:
        order: (N,) the slices, from low to high along the normal.
        positions_mm: (N, 3) of the first pixels, in that order.
        normal: (3,) r × c.
        along_row, along_column, spacing_mm: of every slice.
        step_mm: the usual distance between neighbours along the normal.
        gaps_mm: (N − 1,) all distances along the normal.
        missing: (G,) numbers of the gaps that are two or more usual steps wide.
        tilt_deg: angle between the normal and the line through the first pixels.
    """

    order: Int[np.ndarray, "n"]
    positions_mm: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "3"]
    along_row: Float[np.ndarray, "3"]
    along_column: Float[np.ndarray, "3"]
    spacing_mm: tuple[float, float]
    step_mm: float
    gaps_mm: Float[np.ndarray, "g"]
    missing: Int[np.ndarray, "m"]
    tilt_deg: float

    @property
    def is_even(self) -> bool:
        """Whether all gaps are alike, but for the rounding of positions."""
        depth = np.concatenate([[0.0], np.cumsum(self.gaps_mm)])
        off = np.abs(depth - np.linspace(0, depth[-1], len(depth)))
        return bool(off.max() <= max(_EVEN * self.step_mm, _EVEN_MM))

    @property
    def is_upright(self) -> bool:
        """Whether the slices lie straight behind each other: no tilt of the gantry."""
        return self.tilt_deg <= _UPRIGHT_DEG

    @property
    def slices_missing(self) -> int:
        """How many slices the gaps have room for."""
        return int((np.rint(self.gaps_mm[self.missing] / self.step_mm) - 1).sum())

    def frame_T_index(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) from (i, j, k, 1) to mm; its third column is sheared where the gantry was tilted.

        Raises:
            ScanError: if the slices are not even, because then no affine matrix tells where they are.
        """
        if not self.is_even:
            raise ScanError(
                "slices at equal distances", f"{self.gaps_mm.min():.3g} to {self.gaps_mm.max():.3g} mm", "resample them"
            )
        matrix = np.eye(4)
        matrix[:3, 0] = self.along_row * self.spacing_mm[0]
        matrix[:3, 1] = self.along_column * self.spacing_mm[1]
        matrix[:3, 2] = (self.positions_mm[-1] - self.positions_mm[0]) / (len(self.order) - 1)
        matrix[:3, 3] = self.positions_mm[0]
        return matrix


def stacked(planes: Sequence[Plane]) -> Stack:
    """The slices of one series as a stack.

    Raises:
        ScanError: if there are fewer than three, they differ in orientation, size or spacing, two lie in one place, or
            they wander sideways in another way than a tilted gantry makes them.
    """
    if len(planes) < FEWEST:
        raise ScanError(f"at least {FEWEST} slices", f"{len(planes)}", "give the whole series")
    first = planes[0]
    _check_alike(planes)
    positions = np.stack([plane.position_mm for plane in planes]).astype(np.float64)
    depth = positions @ first.normal
    order = np.argsort(depth, kind="stable")
    positions, gaps = positions[order], np.diff(depth[order])
    _check_apart(gaps)
    step = float(np.median(gaps))
    missing = np.flatnonzero(gaps > 1.5 * step)
    aside = positions - (positions @ first.normal)[:, None] * first.normal
    slope = _slope(depth[order], aside)
    tilt_deg = float(np.rad2deg(np.arctan(np.linalg.norm(slope))))
    return Stack(
        order,
        positions,
        first.normal,
        first.along_row,
        first.along_column,
        first.spacing_mm,
        step,
        gaps,
        missing,
        tilt_deg,
    )


def _check_alike(planes: Sequence[Plane]) -> None:
    first = planes[0]
    turned_rad = max(plane.turned_rad(first) for plane in planes)
    if turned_rad > SAME_DIRECTION_RAD:
        raise ScanError(
            "slices of one orientation",
            f"some that are turned by {np.rad2deg(turned_rad):.1f}°",
            "give one series without localisers",
        )
    shapes = sorted({plane.shape for plane in planes})
    if len(shapes) > 1:
        told = " and ".join(f"{ni}×{nj}" for ni, nj in shapes[:3])
        raise ScanError("slices of one size", told, "give one series")
    spacing = np.array([plane.spacing_mm for plane in planes])
    if (np.ptp(spacing, axis=0) > _SAME_SPACING * spacing.min(axis=0)).any():
        raise ScanError(
            "slices of one pixel spacing", f"{spacing.min():.4g} to {spacing.max():.4g} mm", "give one series"
        )


def _check_apart(gaps: Float[np.ndarray, "g"]) -> None:
    close = int((gaps < SAME_PLACE_MM).sum())
    if close:
        raise ScanError(
            "every slice in a place of its own",
            f"{close + 1 if close < 2 else close} slices or more in the place of another",
            "give one series, without copies",
        )


def _slope(depth: Float[np.ndarray, "n"], aside: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """How far slices move sideways for each mm along the normal."""
    centred, across = depth - depth.mean(), aside - aside.mean(axis=0)
    slope = centred @ across / (centred @ centred)
    off = float(np.linalg.norm(across - centred[:, None] * slope, axis=1).max())
    if off > _ASIDE_MM:
        raise ScanError(
            "slices straight behind each other, or shifted in equal steps by a tilted gantry",
            f"slices up to {off:.2g} mm aside",
            "give one series, reconstructed in one piece",
        )
    return np.asarray(slope)


def _told(vector: Float[np.ndarray, "n"]) -> str:
    return "(" + ", ".join(f"{number:.4g}" for number in vector) + ")"
