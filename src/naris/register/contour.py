"""Where there is a picture: a pose moved until the edges of walls fall on edges of the picture.

The edge of a turbinate in front of what lies behind it is the sharpest thing that a frame shows, and no depth tells it
as well. The walls are rendered at the pose, pixels where the depth jumps are edges, and along the normal of each the
strongest change of the picture is sought; the pose is moved to meet them by Gauss–Newton, held by how sure it was
without the picture (C. Harris and C. Stennett, "RAPID", BMVC 1990; T. Drummond and R. Cipolla, PAMI 2002, on weights).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.core.results import Registration
from naris.errors import ImageError
from naris.register.look import JUMP, depth_from
from naris.render.scene import Scene

FEWEST_EDGES = 20
_MOST_EDGES = 300
_REACH = (0.06, 0.06, 0.04, 0.03, 0.02, 0.015, 0.015, 0.015)
"""Of the width of the picture: how far an edge is sought to either side, in each round."""
_BLUR_PX, _NORMAL_BLUR_PX = 1.2, 2.0
_DARK = 8.0  # grey levels, added before the logarithm: noise is no contrast
_FAINT, _CLEAR = 0.015, 0.08  # changes of the logarithm over a pixel: no edge, and surely one
_SD_PX = 1.5
_ALIKE = 0.07  # edges beside each other are off together, and where walls are: each tells little
_IN_COVARIANCE = 0.7  # of what the edges tell: with all of it errors were larger than it says
_NEARER = 0.5  # the share of the distance that may be left: edges of another place come less near
_LONGEST_MM, _LONGEST_RAD = 1.0, 0.1
_NUDGE_MM = 1e-3
_FRAME_GREY = 14  # what is darker is the black frame around the picture of an endoscope


@dataclass(frozen=True, eq=False)
class Sharpened:
    """What came of it.

    Attributes:
        registration: with pose and covariance as they are with the picture; as it was where there are too few edges.
        edges: how many places of the last round had an edge of the picture near.
        moved_mm, moved_deg: from the pose without the picture.
        off_px: the median distance of walls' edges from the picture's, before and after, sought equally far away; NaN
            where there are too few.
    """

    registration: Registration
    edges: int
    moved_mm: float
    moved_deg: float
    off_px: tuple[float, float]


@dataclass(frozen=True, eq=False)
class _Edges:
    """Places on the edges of walls (N), and where the picture has an edge beside them.

    Attributes:
        off_px: along the normal, towards what lies behind.
        slope: (N, 6) of that distance by the twist of the camera (mm, rad).
        weight: of each, 0 where the picture shows no edge.
    """

    off_px: Float[np.ndarray, "n"]
    slope: Float[np.ndarray, "n 6"]
    weight: Float[np.ndarray, "n"]

    @property
    def seen(self) -> int:
        return int((self.weight > 0).sum())

    @property
    def middle_px(self) -> float:
        return float(np.median(np.abs(self.off_px[self.weight > 0]))) if self.seen else float("nan")


def sharpened(
    scene: Scene, found: Registration, frame: UInt8[np.ndarray, "h w 3"], intrinsics: Intrinsics
) -> Sharpened:
    """Move the best pose of a registration until edges of walls fall on edges of the frame.

    What was decided, and the probability, stay as they were: they were fitted without pictures.

    Args:
        scene: the anatomy that was registered to.
        found: the registration of the camera that took the frame.
        frame: (H, W, 3) sRGB.
        intrinsics: of its camera; the size is that of the frame.

    Raises:
        ImageError: if frame and intrinsics differ in size.
    """
    check_size(frame, intrinsics)
    picture, information = _picture(frame), np.linalg.inv(found.covariance)
    pose, twist = found.best, np.zeros(6)
    edges = first = _edges(scene, pose, picture, intrinsics, _REACH[0])
    for reach in (*_REACH[1:], _REACH[-1]):
        if edges.seen < FEWEST_EDGES:
            return Sharpened(found, edges.seen, 0.0, 0.0, (np.nan, np.nan))
        matrix, right = _equations(edges)
        step = np.linalg.solve(matrix + information, right - information @ twist)
        moved_mm, moved_rad = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
        step *= min(1.0, _LONGEST_MM / max(moved_mm, 1e-9), _LONGEST_RAD / max(moved_rad, 1e-9))
        pose, twist = pose @ Pose.exp(step, CAMERA, CAMERA), twist + step
        edges = _edges(scene, pose, picture, intrinsics, reach)
    # With the reach of the first round: within a shorter one edges are near whatever the picture shows.
    off_px = (first.middle_px, _edges(scene, pose, picture, intrinsics, _REACH[0]).middle_px)
    if edges.seen < FEWEST_EDGES or not off_px[1] <= _NEARER * off_px[0]:
        return Sharpened(found, edges.seen, 0.0, 0.0, off_px)
    matrix, _ = _equations(edges)
    moved = replace(
        found,
        best=pose,
        anatomy_T_camera=None if found.anatomy_T_camera is None else pose,
        covariance=np.linalg.inv(_IN_COVARIANCE * matrix + information),
    )
    by = (found.best.inverse() @ pose).log()
    return Sharpened(
        moved,
        edges.seen,
        float(np.linalg.norm(by[:3])),
        float(np.rad2deg(np.linalg.norm(by[3:]))),
        off_px,
    )


def _picture(frame: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    """The logarithm of its brightness, blurred a little; NaN in and near what may be a black frame around it.

    Whether it has the shape of one (`naris.locate.view`) is not asked: what is black to the border tells no edge.
    """
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    picture = np.log(cv2.GaussianBlur(grey, (0, 0), _BLUR_PX) + _DARK)
    black = black_border(frame)
    if black.any():
        around = cv2.dilate(black.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        picture[around] = np.nan
    return np.asarray(picture, dtype=np.float32)


def check_size(frame: UInt8[np.ndarray, "h w 3"], intrinsics: Intrinsics) -> None:
    """See that a frame has the size that its intrinsics say.

    Raises:
        ImageError: if not.
    """
    if frame.shape[:2] != (intrinsics.height, intrinsics.width):
        raise ImageError(
            f"a frame of {intrinsics.width}×{intrinsics.height} pixels, as the intrinsics say",
            f"{frame.shape[1]}×{frame.shape[0]}",
            "give the frame as that camera took it",
        )


def black_border(frame: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
    """What may be the black frame around a picture: all that is black from there to the border."""
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    count, pieces = cv2.connectedComponents((grey < _FRAME_GREY).astype(np.uint8))
    border = np.unique(np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]]))
    return np.isin(pieces, border[border > 0]) if count > 1 else np.zeros(grey.shape, bool)


def _edges(
    scene: Scene, pose: Pose, picture: Float32[np.ndarray, "h w"], intrinsics: Intrinsics, reach: float
) -> _Edges:
    """Edges of the walls as seen from a pose, and the strongest edge of the picture beside each."""
    depth = depth_from(scene, pose, intrinsics)
    near, at_px, normal = _jumps(depth)
    if not len(near):
        return _Edges(np.zeros(0), np.zeros((0, 6)), np.zeros(0))
    off_px, clearness = _beside(picture, at_px, normal, reach * intrinsics.width)
    z = depth[near[:, 1], near[:, 0]]
    rays = intrinsics.unproject(near.astype(np.float64))
    points = rays / rays[:, 2:] * z[:, None]
    moved = [intrinsics.project(points + _NUDGE_MM * axis)[0] for axis in np.eye(3)]
    here = intrinsics.project(points)[0]
    by_point = np.stack([((one - here) * normal).sum(axis=1) / _NUDGE_MM for one in moved], axis=1)
    # A camera that moves by (v, w) sees a point p move by −v − w × p.
    slope = np.concatenate([-by_point, -np.cross(points, by_point)], axis=1)
    robust = 1 / (1 + (off_px / _SD_PX) ** 2 / 4)
    return _Edges(off_px, slope, clearness * robust)


def _jumps(
    depth: Float[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Pixels (x, y) in front of a jump of the depth, where it is, and its unit normal towards what lies behind."""
    known = depth > 0
    log = np.log(np.where(known, depth, 1.0))
    found = []
    for axis in (0, 1):
        jump = np.diff(log, axis=axis)
        first, second = (known[:-1], known[1:]) if axis == 0 else (known[:, :-1], known[:, 1:])
        row, column = np.nonzero((np.abs(jump) > JUMP) & first & second)
        is_first = jump[row, column] > 0
        down, right = (1, 0) if axis == 0 else (0, 1)
        near = np.stack([column + right * ~is_first, row + down * ~is_first], axis=1)
        found.append(np.concatenate([near, np.stack([column + right / 2, row + down / 2], axis=1)], axis=1))
    both = np.concatenate(found)
    chosen = both[np.random.default_rng(0).permutation(len(both))[:_MOST_EDGES]]
    blurred = cv2.GaussianBlur(log.astype(np.float32), (0, 0), _NORMAL_BLUR_PX)
    by_row, by_column = np.gradient(blurred)
    near = chosen[:, :2].astype(np.int64)
    normal = np.stack([by_column[near[:, 1], near[:, 0]], by_row[near[:, 1], near[:, 0]]], axis=1).astype(np.float64)
    length = np.linalg.norm(normal, axis=1)
    sure = length > 1e-3
    return near[sure], chosen[sure, 2:], normal[sure] / length[sure, None]


def _beside(
    picture: Float32[np.ndarray, "h w"],
    at_px: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "n 2"],
    reach_px: float,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """How far along the normal the picture changes most, nearer changes before others, and how clearly (0 to 1)."""
    along = np.arange(-reach_px, reach_px + 0.25, 0.5)
    places = (at_px[:, None] + along[None, :, None] * normal[:, None]).astype(np.float32)
    profile = cv2.remap(picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderValue=float("nan"))
    change = np.nan_to_num(np.abs(np.gradient(profile, axis=1)) / 0.5)
    best = (change * np.exp(-0.5 * (along / (0.5 * reach_px)) ** 2)).argmax(axis=1)
    clear = change[np.arange(len(best)), best]
    return along[best], np.where(clear > _FAINT, np.clip(clear / _CLEAR, 0, 1) ** 2, 0.0)


def _equations(edges: _Edges) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    weighted = edges.slope * (_ALIKE / _SD_PX**2 * edges.weight)[:, None]
    return weighted.T @ edges.slope, weighted.T @ edges.off_px
