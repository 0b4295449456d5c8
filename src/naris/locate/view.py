"""From a picture as a camera gave it to the view that a network was trained on: no black frame, the same angle.

Endoscopes show a round picture on a black frame. Where such a frame is found, there are two ways to look: at the whole
disc with its black corners, or at the largest upright square inside, whose angle is smaller. Which is nearer to the
training's angle nobody knows without the camera's intrinsics, so both are offered. A dark passage is no frame: the dark
part counts only if what is left has the shape of a disc, cut or whole, or is a rectangle centred between bars.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from naris.core.camera import Intrinsics, middle_square
from naris.errors import ImageError
from naris.model.localizer import fitted

_DARK = 14  # grey levels: a black frame after video compression, blurred over a few pixels
_DETECT_PX = 256
_ROUND = 0.93
_SMALLEST = 0.2
_BAR = 0.02
_OFF_CENTRE = 0.04
_FINER = 3
_OTHER_SHAPE = 0.01  # of the ratio of width to height: more than rounding after resizing


@dataclass(frozen=True)
class VisibleArea:
    """The squares of a picture that are worth looking at, each as (left, top, edge) in pixels.

    Attributes:
        inner: the largest square inside the visible part.
        outer: a square around a disc, which may reach beyond the picture; else the same as `inner`.
        kind: `whole` where no frame was found (then the square is the middle of the picture), `round` or `bars`.
    """

    inner: tuple[int, int, int]
    outer: tuple[int, int, int]
    kind: Literal["whole", "round", "bars"]


def visible_area(image: UInt8[np.ndarray, "h w 3"]) -> VisibleArea:
    """What a black frame leaves of a picture."""
    height, width = image.shape[:2]
    scale = min(_DETECT_PX / max(height, width), 1.0)
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    bright = cv2.blur(small.max(axis=2), (3, 3)) > _DARK
    # The blur let the picture grow over its edge by a pixel.
    hull = _hull(cv2.erode(bright.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
    kind = "whole" if hull is None else _kind(hull)
    if hull is None or kind == "whole":
        middle = middle_square(width, height)
        return VisibleArea(middle, middle, "whole")
    column, row, half = _largest_square(hull)
    size = min(int((2 * half - 1) / scale), height, width)
    left = int(np.clip((column + 0.5) / scale - size / 2, 0, width - size))
    top = int(np.clip((row + 0.5) / scale - size / 2, 0, height - size))
    inner = (left, top, size)
    return VisibleArea(inner, _around(hull, scale) if kind == "round" else inner, kind)


def views_of(
    image: UInt8[np.ndarray, "h w 3"], size_px: int, made_for: Intrinsics, intrinsics: Intrinsics | None = None
) -> list[UInt8[np.ndarray, "{size_px} {size_px} 3"]]:
    """The picture as a network's own camera may have taken it: one view, or two of a round picture of unknown angle.

    Args:
        image: RGB.
        size_px: edge of the network's input.
        made_for: the camera of the network's training.
        intrinsics: of the picture's camera, lens and all; the rays of the two cameras are then matched, and what the
            picture does not show is black. Without, the visible area is taken whatever its angle is.

    Raises:
        ImageError: if the picture has not the shape of those that the intrinsics are for.
    """
    if intrinsics is None:
        area = visible_area(image)
        return [fitted(_cut(image, square)[None], size_px)[0] for square in dict.fromkeys((area.inner, area.outer))]
    height, width = image.shape[:2]
    if abs(width * intrinsics.height / (height * intrinsics.width) - 1) > _OTHER_SHAPE:
        # A part of the camera's picture: which one, and with it every ray, would be a guess.
        raise ImageError(
            f"a picture of the shape {intrinsics.width}×{intrinsics.height} that the intrinsics are for",
            f"{width}×{height}",
            "give the intrinsics of this very picture, or none",
        )
    finer = made_for.resized(_FINER * size_px, _FINER * size_px)
    found = intrinsics.resized(width, height)
    pixels, inside = found.project(finer.rays())
    pixels = np.where(inside[..., None], pixels, -10.0).astype(np.float32)
    shrunk, pixels = _not_finer(image, pixels)
    seen = cv2.remap(shrunk, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return [fitted(seen[None], size_px)[0]]


def _cut(image: UInt8[np.ndarray, "h w 3"], square: tuple[int, int, int]) -> UInt8[np.ndarray, "s s 3"]:
    """A square of a picture, black where it reaches beyond."""
    left, top, size = square
    out = np.zeros((size, size, 3), np.uint8)
    rows = slice(max(top, 0), min(top + size, image.shape[0]))
    columns = slice(max(left, 0), min(left + size, image.shape[1]))
    out[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = image[rows, columns]
    return out


def _around(hull: Bool[np.ndarray, "h w"], scale: float) -> tuple[int, int, int]:
    """The square around the disc that the hull is (a part of)."""
    (x, y), radius = cv2.minEnclosingCircle(cv2.findNonZero(hull.astype(np.uint8)))
    size = 2 * (radius + 0.5) / scale
    return round((x + 0.5) / scale - size / 2), round((y + 0.5) / scale - size / 2), round(size)


def _not_finer(
    image: UInt8[np.ndarray, "h w 3"], pixels: Float[np.ndarray, "n n 2"]
) -> tuple[UInt8[np.ndarray, "a b 3"], Float[np.ndarray, "n n 2"]]:
    """A picture of so many more pixels than are asked for is shrunk first, so that none is skipped."""
    steps = np.linalg.norm(np.diff(pixels, axis=1), axis=-1)
    factor = float(np.median(steps))
    if factor < 1.5:
        return image, pixels
    height, width = max(round(image.shape[0] / factor), 1), max(round(image.shape[1] / factor), 1)
    shrunk = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    ratio = np.array([width / image.shape[1], height / image.shape[0]])
    return shrunk, ((pixels + 0.5) * ratio - 0.5).astype(np.float32)


def _hull(bright: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"] | None:
    """The convex hull of the largest bright part: a dark passage in the middle belongs to the picture."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(bright.astype(np.uint8), connectivity=8)
    if count < 2:
        return None
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    parts = labels == largest
    for label in range(1, count):
        # A frame may be lit in two halves around a dark passage; letters beside the picture are small.
        if stats[label, cv2.CC_STAT_AREA] > _SMALLEST * stats[largest, cv2.CC_STAT_AREA]:
            parts |= labels == label
    points = cv2.findNonZero(parts.astype(np.uint8))
    hull = np.zeros(bright.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
    return hull.astype(bool)


def _kind(hull: Bool[np.ndarray, "h w"]) -> Literal["whole", "round", "bars"]:
    height, width = hull.shape
    rows, columns = np.flatnonzero(hull.any(axis=1)), np.flatnonzero(hull.any(axis=0))
    margins = np.array(
        [columns[0] / width, 1 - (columns[-1] + 1) / width, rows[0] / height, 1 - (rows[-1] + 1) / height]
    )
    corners = hull[[0, 0, -1, -1], [0, -1, 0, -1]]
    if hull.mean() < _SMALLEST**2 or (corners.any() and margins.max() < _BAR):
        return "whole"
    if not corners.any() and _disc_share(hull) > _ROUND:
        return "round"
    box = (rows[-1] - rows[0] + 1) * (columns[-1] - columns[0] + 1)
    filled = hull.sum() / box > _ROUND
    centred = abs(margins[0] - margins[1]) < _OFF_CENTRE and abs(margins[2] - margins[3]) < _OFF_CENTRE
    return "bars" if filled and centred and margins.max() >= _BAR else "whole"


def _disc_share(hull: Bool[np.ndarray, "h w"]) -> float:
    """How well the hull is a disc, cut off by the picture's edges or by straight bars: intersection over union."""
    outline = cv2.findNonZero(hull.astype(np.uint8))
    (x, y), radius = cv2.minEnclosingCircle(outline)
    v, u = np.mgrid[0 : hull.shape[0], 0 : hull.shape[1]]
    rows, columns = np.flatnonzero(hull.any(axis=1)), np.flatnonzero(hull.any(axis=0))
    disc = np.hypot(u - x, v - y) <= radius + 0.5
    disc &= (v >= rows[0]) & (v <= rows[-1]) & (u >= columns[0]) & (u <= columns[-1])
    is_box = hull.sum() > 0.97 * (rows[-1] - rows[0] + 1) * (columns[-1] - columns[0] + 1)
    return 0.0 if is_box else float((disc & hull).sum() / (disc | hull).sum())


def _largest_square(hull: Bool[np.ndarray, "h w"]) -> tuple[int, int, float]:
    """Column, row and half the edge of the largest upright square inside; of several the one nearest to the middle."""
    padded = np.pad(hull.astype(np.uint8), 1)
    reach = cv2.distanceTransform(padded, cv2.DIST_C, 3)[1:-1, 1:-1]
    best = np.argwhere(reach >= reach.max() - 0.5)
    middle = np.argwhere(hull).mean(axis=0)
    row, column = best[np.argmin(np.linalg.norm(best - middle, axis=1))]
    return int(column), int(row), float(reach[row, column])
