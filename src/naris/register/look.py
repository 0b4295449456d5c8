"""What a registered camera sees beside what it saw: the edges of walls that the pose puts into the picture."""

from __future__ import annotations

import io

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw

from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.render.scene import Scene, render

JUMP = 0.12
"""Neighbouring depths that differ by more than this share are an edge: a turbinate in front of what lies behind."""
_EDGE_RGB, _EDGES_ACROSS = (60, 255, 120), 240  # so many lines would cover a picture
_LEVEL_RGB, _LEVELS, _FEW_EDGES = (90, 200, 255), 8, 0.5  # of a wall with edges less long than half the picture
_NEIGHBOURS = (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])  # to the right and below
_BLACK = 12  # and the noise of a camera
_REFUSED_RGB, _WARNING = (150, 20, 20), "REFUSED: the best guess, not to be used"
_HALVES = "what was seen, with walls as guessed", "what a camera there would see"
_WHITE = (255, 255, 255)
_LEAST_WIDE, _FRAMES, _HEADS, _FEET = 240, 80, 5, 3  # of the frame: how many go into the pair, the head and the foot
_FAR_SHARE = 0.98
_BLINK_MS = 600


def seen_from(
    scene: Scene, pose: Pose, intrinsics: Intrinsics
) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """The picture and the z-depth (mm, 0 where none) of a camera there."""
    found = render(scene, pose, intrinsics, want=("rgb", "depth"))
    empty = np.zeros((1, intrinsics.height, intrinsics.width))
    rgb = found.rgb if found.rgb is not None else np.repeat(empty[..., None], 3, -1).astype(np.uint8)
    depth = found.depth_mm if found.depth_mm is not None else empty
    return rgb[0], np.asarray(depth[0], dtype=np.float64)


def depth_from(scene: Scene, pose: Pose, intrinsics: Intrinsics) -> Float[np.ndarray, "h w"]:
    """The z-depth (mm, 0 where none) of a camera there, without a picture."""
    depth = render(scene, pose, intrinsics, want=("depth",)).depth_mm
    return np.zeros((intrinsics.height, intrinsics.width)) if depth is None else np.asarray(depth[0], dtype=np.float64)


def edges(depth: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels where the depth jumps to the right or below; beside what is not seen, those that are seen."""
    log, seen = np.log(np.maximum(depth, 1e-3)), depth > 0
    jump = np.zeros(depth.shape, dtype=bool)
    for one, next_ in _NEIGHBOURS:
        jumps = np.abs(log[next_] - log[one]) > JUMP
        jump[one] |= jumps
        jump[next_] |= jumps & ~seen[one]
    return jump & seen


def levels(depth: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Lines of equal depth, as far apart as its logarithm changes in equal steps: the shape of a wall without edges."""
    seen = depth > 0
    if not seen.any():
        return seen
    log = np.log(np.where(seen, depth, 1.0))
    low, high = float(log[seen].min()), float(log[seen].max())
    level = np.minimum(np.floor((log - low) * _LEVELS / max(high - low, 1e-6)), _LEVELS - 1)
    lines = np.zeros(depth.shape, dtype=bool)
    for one, next_ in _NEIGHBOURS:
        lines[one] |= (level[one] != level[next_]) & seen[one] & seen[next_]
    return lines


def overlay(picture: UInt8[np.ndarray, "h w 3"], depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """The edges of the walls drawn on a picture of the same size, but for what a stop of the scope hides.

    Where a wall has hardly any, lines of equal depth (`levels`) are drawn in another colour, under the edges.
    """
    drawn, shown = picture.copy(), ~_behind_stop(picture)
    wide = max(2, round(min(depth.shape) / _EDGES_ACROSS))
    found = edges(depth)
    if found.sum() < _FEW_EDGES * min(depth.shape):
        drawn[_wider(levels(depth), wide // 2) & shown] = _LEVEL_RGB
    drawn[_wider(found, wide) & shown] = _EDGE_RGB
    return drawn


def _wider(lines: Bool[np.ndarray, "h w"], wide: int) -> Bool[np.ndarray, "h w"]:
    return np.asarray(cv2.dilate(lines.astype(np.uint8), np.ones((wide, wide), np.uint8)) > 0)


def _behind_stop(picture: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
    """What lies outside the circle around all that is lit, where the four corners are black.

    A dark passage belongs to the picture, also where it touches the stop.
    """
    lit = cv2.erode((picture.max(axis=2) > _BLACK).astype(np.uint8), np.ones((3, 3), np.uint8))
    if lit[[0, 0, -1, -1], [0, -1, 0, -1]].any() or not lit.any():
        return np.zeros(lit.shape, dtype=bool)
    (x, y), radius = cv2.minEnclosingCircle(cv2.findNonZero(lit))
    v, u = np.mgrid[: lit.shape[0], : lit.shape[1]]
    return np.hypot(u - x, v - y) > radius + 2


def refused(
    picture: UInt8[np.ndarray, "h w 3"], rgb: UInt8[np.ndarray, "h w 3"], depth: Float[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "k v 3"]:
    """The edges of a guess on the picture, beside what a camera there sees: framed and headed as what it is."""
    larger = -(-_LEAST_WIDE // picture.shape[1])
    pair = np.concatenate([overlay(picture, depth), rgb], axis=1).repeat(larger, axis=0).repeat(larger, axis=1)
    side = pair.shape[1] // _FRAMES
    head, foot = _HEADS * side, _FEET * side
    framed = np.full((len(pair) + head + foot, pair.shape[1] + 2 * side, 3), _REFUSED_RGB, np.uint8)
    framed[head:-foot, side:-side] = pair
    made = Image.fromarray(framed)
    draw = ImageDraw.Draw(made)
    draw.text((side, side), _WARNING, fill=_WHITE, font_size=head - 2 * side)
    for half, told in enumerate(_HALVES):
        place = side + half * pair.shape[1] // 2, len(framed) - foot
        draw.text(place, told, fill=_WHITE, font_size=foot - side)
    return np.asarray(made)


def shaded(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """A depth image as colours, near bright: for a picture where there is none."""
    is_known = (depth > 0) & np.isfinite(depth)
    far = float(np.quantile(depth[is_known], _FAR_SHARE)) if is_known.any() else 1.0
    near = 1 - np.where(is_known, depth, far) / far
    grey = np.where(is_known, 255 * np.clip(near, 0, 1) ** 0.7, 0).astype(np.uint8)
    return np.asarray(cv2.cvtColor(cv2.applyColorMap(grey, cv2.COLORMAP_MAGMA), cv2.COLOR_BGR2RGB))


def png(picture: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """A picture as a file."""
    kept = io.BytesIO()
    Image.fromarray(picture).save(kept, "PNG")
    return kept.getvalue()


def blinking(first: UInt8[np.ndarray, "h w 3"], second: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """Two pictures of one size in turn for ever, as an animated GIF."""
    one, other = (Image.fromarray(picture) for picture in (first, second))
    kept = io.BytesIO()
    one.save(kept, "GIF", save_all=True, append_images=[other], duration=_BLINK_MS, loop=0)
    return kept.getvalue()
