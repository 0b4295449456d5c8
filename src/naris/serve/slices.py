"""Three slices of a CT through a place, each with the wall of the anatomy drawn on it.

As radiologists look at them: axial from below and coronal from the front, the patient's left on the right; sagittal
from the left, the back of the head on the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import map_coordinates

from naris.anatomy.distance import SignedDistance
from naris.core.volume import LPS, Volume
from naris.errors import ScanError

AIR_HU = -1024.0
_MARGIN_MM = 1.0
WALL = (255, 210, 60)
PLANES = {"axial": ((1, 0, 0), (0, 1, 0)), "coronal": ((1, 0, 0), (0, 0, -1)), "sagittal": ((0, 1, 0), (0, 0, -1))}
"""What is right and what is down in each picture, in LPS."""


@dataclass(frozen=True, eq=False)
class Slices:
    """A CT and the distances to the walls that were found in it.

    Raises:
        ScanError: if the anatomy does not lie in the scan.
    """

    volume: Volume
    distance: SignedDistance

    def __post_init__(self) -> None:
        if self.distance.frame != LPS:
            raise ScanError("an anatomy in LPS, as a scan is", f"one in {self.distance.frame}", "leave --ct out")
        low, high = self.volume.bounds_mm
        air = np.argwhere(self.distance.values_mm > 0)
        first, last = (self.distance.origin_mm + self.distance.spacing_mm * f(air, axis=0) for f in (np.min, np.max))
        if not ((first >= low - _MARGIN_MM) & (last <= high + _MARGIN_MM)).all():
            raise ScanError(
                "the scan that the anatomy was found in",
                f"one from {_mm(low)} to {_mm(high)}, where the anatomy's air is from {_mm(first)} to {_mm(last)}",
                "give that scan with --ct",
            )

    def picture(
        self, place_mm: Float[np.ndarray, "3"], span_mm: float, size_px: int, window: tuple[float, float]
    ) -> UInt8[np.ndarray, "n m 3"]:
        """The three of `PLANES` side by side, (n, 3 n, 3), each `span_mm` wide with the place in its middle.

        Args:
            place_mm: in the anatomy.
            span_mm: width of each.
            size_px: of each, n.
            window: level and width (HU): black is level − width / 2, white level + width / 2.
        """
        return np.concatenate([self._slice(place_mm, *axes, span_mm, size_px, window) for axes in PLANES.values()], 1)

    def _slice(
        self,
        place: Float[np.ndarray, "3"],
        right: tuple[int, int, int],
        down: tuple[int, int, int],
        span: float,
        size: int,
        window: tuple[float, float],
    ) -> UInt8[np.ndarray, "n n 3"]:
        at = span * ((np.arange(size) + 0.5) / size - 0.5)
        points = place + at[None, :, None] * np.array(right) + at[:, None, None] * np.array(down)
        index = (points - self.volume.frame_T_index[:3, 3]) @ np.linalg.inv(self.volume.frame_T_index[:3, :3]).T
        hu = map_coordinates(
            self.volume.hu, np.moveaxis(index, -1, 0), np.float32, order=1, mode="constant", cval=AIR_HU
        )
        level, width = window
        grey = np.clip(255 * ((hu - level) / width + 0.5), 0, 255).astype(np.uint8)
        shown = np.repeat(grey[..., None], 3, axis=2)
        shown[_edge(self.distance(points) > 0)] = WALL
        return shown


def _edge(inside: np.ndarray) -> np.ndarray:
    """Where a mask ends to the right or below."""
    edge = np.zeros_like(inside)
    edge[:, :-1] |= inside[:, :-1] != inside[:, 1:]
    edge[:-1] |= inside[:-1] != inside[1:]
    return edge


def _mm(point: Float[np.ndarray, "3"]) -> str:
    return "(" + ", ".join(f"{x:.0f}" for x in point) + ") mm"
