"""What a camera saw, as ranges along rays with what is known of their errors: depth images, clouds, several views.

Everything lies in one frame, the **rig**: that of the camera for a single view, that of the first camera for several.
The scale is stated by the caller and never guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.core.results import DepthEstimate
from naris.errors import InputError, PoseError
from naris.register.noise import KNOWN, DepthNoise, PointNoise, Scale

MOST_POINTS = 1024
"""Of a view: of more of them, whose errors are never quite independent, the evidence is surer than it should be."""
_BLOCKS = 32
_CONSISTENT = 4.5
_NEAR_MM, _FAR_MM = 0.05, 1000.0
_FEWEST = 12
_MOST_BEHIND = 0.1
_ROUNDED_MM = 0.03  # what the map rounds off
_NETWORK_OUTLIERS = 0.05
_FLAT = 0.01  # rad: a view that is thinner leaves the pose loose


@dataclass(frozen=True, eq=False)
class Observation:
    """Ranges along rays. Make it with `from_depth`, `from_points`, `from_sightings` or `together`.

    Attributes:
        origins: (N, 3) where each ray begins in the rig, in the unit of the observation.
        directions: (N, 3) unit, in the rig.
        ranges: (N,) along the rays, in the unit of the observation.
        radial, isotropic: (N,) standard deviations along the ray and in every direction.
        view: (N,) the camera of each ray, rising from 0; within a view, neighbouring rays follow each other.
        outliers: the share that tells nothing.
        smooth, reach_deg: of the smooth relative error, as in `DepthNoise`; 0 for none.
        scale: what is known of the unit.
        normals: (N, 3) unit, of the wall towards the camera, in the rig; None where they are not known.
        normals_rad: their standard deviation.
        is_cloud: whether these are points, off in every direction, and not distances along rays that are known.
        by_network: whether a network told these distances from a picture: its errors are as it claims them.
    """

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    ranges: Float[np.ndarray, "n"]
    radial: Float[np.ndarray, "n"]
    isotropic: Float[np.ndarray, "n"]
    view: Int[np.ndarray, "n"]
    outliers: float
    smooth: float = 0.0
    reach_deg: float = 9.3
    scale: Scale = KNOWN
    normals: Float[np.ndarray, "n 3"] | None = None
    normals_rad: float = np.inf
    is_cloud: bool = False
    by_network: bool = False

    def __len__(self) -> int:
        return len(self.ranges)

    @property
    def views(self) -> int:
        return int(self.view[-1]) + 1

    def some(self, most: int) -> Observation:
        """About so many of its rays, evenly chosen of each view; no more than that of one."""
        if len(self) <= most:
            return self
        return self.rows(_evenly(self.view, most))

    def used(self) -> Observation:
        """What a registration takes of it: of a cloud at most `MOST_POINTS` a view, evenly chosen."""
        if not self.is_cloud or len(self) <= MOST_POINTS:
            return self
        of_each = [np.flatnonzero(self.view == view) for view in range(self.views)]
        return self.rows(np.concatenate([of[_evenly(self.view[of], MOST_POINTS)] for of in of_each]))

    def rows(self, chosen: np.ndarray) -> Observation:
        """Some of its rays, by number or by a mask, in that order."""
        parts: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        return replace(self, **parts, normals=None if self.normals is None else self.normals[chosen])


_ARRAYS = ("origins", "directions", "ranges", "radial", "isotropic", "view")


def from_depth(
    depth: Float[np.ndarray, "..."],
    intrinsics: Intrinsics,
    noise: DepthNoise = DepthNoise(),
    scale: Scale = KNOWN,
    sd: Float[np.ndarray, "..."] | None = None,
) -> Observation:
    """A depth image (H, W) (z-depth, 0 or NaN where it is not known), in blocks of pixels.

    Where the pixels of a block agree, their mean stands for them, with so much less noise; across an edge one pixel
    does.

    Args:
        depth: of each pixel.
        intrinsics: of the camera, as large.
        noise: of all of it.
        scale: what is known of the unit.
        sd: (H, W) standard deviation of each pixel's depth by itself, in the unit of the depth, in the place of
            `noise.pixel_mm`; a pixel without one above 0 is not used.

    Raises:
        InputError: if a shape is not that of the intrinsics, or too little of it can be used.
    """
    depth = np.asarray(depth, dtype=np.float64)
    if depth.shape != (intrinsics.height, intrinsics.width):
        raise InputError(
            f"a depth image of {intrinsics.height} × {intrinsics.width} pixels to match the intrinsics",
            " × ".join(map(str, depth.shape)),
            "resize one of them",
        )
    rays = intrinsics.rays()
    ahead = np.where(np.isfinite(rays[..., 2]), rays[..., 2], 0.0)
    ranges = np.where((depth > 0) & np.isfinite(depth) & (ahead > 1e-3), depth / np.maximum(ahead, 1e-3), np.nan)
    if sd is not None:
        if np.shape(sd) != depth.shape:
            got = " × ".join(map(str, np.shape(sd)))
            raise InputError(f"deviations of as many pixels, {depth.shape[0]} × {depth.shape[1]}", got, "resize them")
        sd = np.asarray(sd, dtype=np.float64) / np.maximum(ahead, 1e-3)
    return from_ranges(ranges, np.nan_to_num(rays), noise, scale, sd)


def from_ranges(
    ranges: Float[np.ndarray, "h w"],
    rays: Float[np.ndarray, "h w 3"],
    noise: DepthNoise = DepthNoise(),
    scale: Scale = KNOWN,
    sd: Float[np.ndarray, "h w"] | None = None,
) -> Observation:
    """As `from_depth`, of distances along unit rays (NaN where not known), and of deviations along them."""
    if sd is not None:
        ranges = np.where(np.isfinite(sd) & (sd > 0), ranges, np.nan)
    size = max(-(-max(ranges.shape) // _BLOCKS), 1)
    blocks, ways = _in_blocks(ranges, size), _in_blocks(rays, size)
    known = np.isfinite(blocks).sum(axis=1)
    own = None if sd is None else _in_blocks(np.where(np.isfinite(ranges), sd, np.nan), size)[known > 0]
    blocks, ways, known = (each[known > 0] for each in (blocks, ways, known))
    if not len(blocks):
        raise InputError("a depth image with some depth", "none above 0", "check the image and its scale")
    middle, spread = np.nanmedian(blocks, axis=1), np.nanmax(blocks, axis=1) - np.nanmin(blocks, axis=1)
    pixel = np.full(len(blocks), noise.pixel_mm) if own is None else np.sqrt(np.nanmean(own**2, axis=1))
    # Neighbouring pixels of a slanted wall differ too: by about a tenth of the range in a block of a few degrees.
    agree = spread <= _CONSISTENT * np.hypot(pixel, 0.02 * middle)
    nearest = np.nanargmin(np.abs(blocks - middle[:, None]), axis=1)
    row = np.arange(len(blocks))
    weight = np.isfinite(blocks)[..., None]
    mean_way = (ways * weight).sum(axis=1)
    mean_way /= np.maximum(np.linalg.norm(mean_way, axis=1, keepdims=True), 1e-12)
    r = np.where(agree, np.nanmean(blocks, axis=1), blocks[row, nearest])
    directions = np.where(agree[:, None], mean_way, ways[row, nearest])
    alone = pixel if own is None else own[row, nearest]
    pixel = np.where(agree, pixel / np.sqrt(known), alone)
    return _checked(
        Observation(
            origins=np.zeros((len(r), 3)),
            directions=directions,
            ranges=r,
            radial=np.hypot(pixel, 0.12 * noise.smooth * r),
            isotropic=np.full(len(r), _ROUNDED_MM / scale.middle),
            view=np.zeros(len(r), np.int64),
            outliers=noise.outliers,
            smooth=noise.smooth,
            reach_deg=noise.reach_deg,
            scale=scale,
        )
    )


def from_estimate(estimate: DepthEstimate) -> Observation:
    """What a depth network tells of a picture, with the errors that it claims.

    Args:
        estimate: from `naris.locate.depth`. The scale has the prior that the network gives.

    Raises:
        InputError: if it tells too little.
    """
    known = np.isfinite(estimate.ranges_mm)
    ranges, n = estimate.ranges_mm[known], int(known.sum())
    return _checked(
        Observation(
            origins=np.zeros((n, 3)),
            directions=estimate.rays[known],
            ranges=ranges,
            radial=ranges * np.hypot(estimate.sd_log[known], 0.12 * estimate.smooth),
            isotropic=np.full(n, _ROUNDED_MM),
            view=np.zeros(n, np.int64),
            outliers=_NETWORK_OUTLIERS,
            smooth=estimate.smooth,
            reach_deg=estimate.reach_deg,
            scale=Scale("prior", 1.0, estimate.scale_sd_log),
            by_network=True,
        )
    )


def from_points(
    points: Float[np.ndarray, "..."],
    noise: PointNoise = PointNoise(),
    scale: Scale = KNOWN,
    normals: Float[np.ndarray, "n 3"] | None = None,
) -> Observation:
    """Points (N, 3) that one camera sees, in its frame, with the normals (N, 3) of the wall there or without.

    Normals are turned towards the camera.

    Raises:
        InputError: if they are too few, not finite, behind the camera, behind each other on one line, or in another
            unit than is said.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] == 3 and len(points) and (points[:, 2] < 0).mean() > _MOST_BEHIND:
        raise InputError(
            "points in front of the camera, in its frame (x right, y down, z forward)",
            f"{(points[:, 2] < 0).mean():.0%} of them behind it",
            "turn y and z round, or take the points from the world into the camera",
        )
    return from_sightings(points, np.zeros((1, 3)), np.zeros(len(points), np.int64), noise, scale, normals)


def from_sightings(
    points: Float[np.ndarray, "..."],
    cameras: Float[np.ndarray, "v 3"],
    seen_from: Int[np.ndarray, "n"],
    noise: PointNoise = PointNoise(),
    scale: Scale = KNOWN,
    normals: Float[np.ndarray, "n 3"] | None = None,
) -> Observation:
    """Points (N, 3) in the rig, each seen by one of several cameras.

    Args:
        points: in the rig, which is the first camera.
        cameras: where they stand in it.
        seen_from: the number of its camera for each point; every camera has some.
        noise: of the points.
        scale: of all of it.
        normals: (N, 3) of the wall there, in the rig; they are turned towards the camera.

    Raises:
        InputError: as `from_points`.
    """
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        got = f"shape {points.shape}" if points.size else "none"
        raise InputError("points (N, 3)", got, "give a cloud of points")
    if not np.isfinite(points).all():
        bad = int((~np.isfinite(points).all(axis=1)).sum())
        raise InputError("finite points", f"{bad} of {len(points)} with NaN or infinity", "leave them out")
    idle = sorted(set(range(len(cameras))) - set(seen_from.tolist()))
    if idle:
        raise InputError("points that each camera saw", f"none of camera {idle[0]}", "leave that camera out")
    origins = cameras[seen_from]
    ranges = np.linalg.norm(points - origins, axis=1)
    if not ranges.all():
        count = int((ranges == 0).sum())
        raise InputError(
            "points away from the camera", f"{count} of {len(points)} in its centre", "leave out pixels without depth"
        )
    sd = noise.sd_mm
    return _checked(
        Observation(
            origins=origins,
            directions=(points - origins) / np.maximum(ranges, 1e-12)[:, None],
            ranges=ranges,
            radial=np.full(len(points), 1e-3 * sd),
            isotropic=np.full(len(points), sd),
            view=np.asarray(seen_from, dtype=np.int64),
            outliers=noise.outliers,
            scale=scale,
            normals=None if normals is None else _towards_camera(points - origins, normals),
            normals_rad=np.inf if normals is None else float(np.deg2rad(noise.normals_deg)),
            is_cloud=True,
        )
    )


def together(observations: Sequence[Observation], rig_T_camera: Pose) -> Observation:
    """Several views with known relative poses (V,) as one; their unit and scale are one as well.

    The positions in `rig_T_camera` are in the unit of the observations.

    Raises:
        PoseError: if there is not one pose from the camera for each observation.
        InputError: if they differ in kind, scale or smooth error.
    """
    if rig_T_camera.shape != (len(observations),) or rig_T_camera.source != CAMERA:
        raise PoseError(
            f"one pose rig_T_camera for each of {len(observations)} observations",
            f"{rig_T_camera.shape} {rig_T_camera.target}_T_{rig_T_camera.source}",
            "stack them in the order of the observations",
        )
    kinds = {(o.is_cloud, o.scale, o.smooth, o.reach_deg, o.views) for o in observations}
    if len(kinds) != 1 or observations[0].views != 1:
        raise InputError("single views of one scale and one kind of noise", "several", "observe them alike")
    origins, directions, view, normals = [], [], [], []
    for number, (one, rotation, position) in enumerate(
        zip(observations, rig_T_camera.rotation, rig_T_camera.position_mm, strict=True)
    ):
        origins.append(np.broadcast_to(position, (len(one), 3)))
        directions.append(one.directions @ rotation.T)
        view.append(np.full(len(one), number))
        if one.normals is not None:
            normals.append(one.normals @ rotation.T)
    joined: dict[str, Any] = {name: np.concatenate([getattr(o, name) for o in observations]) for name in _ARRAYS[2:5]}
    return replace(
        observations[0],
        origins=np.concatenate(origins),
        directions=np.concatenate(directions),
        view=np.concatenate(view),
        outliers=float(np.mean([o.outliers for o in observations])),
        normals=np.concatenate(normals) if len(normals) == len(observations) else None,
        **joined,
    )


def _towards_camera(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    normals = np.asarray(normals, dtype=np.float64)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if normals.shape != points.shape or not np.isfinite(normals).all() or not (length > 0).all():
        raise InputError(
            f"a normal of some length for each of {len(points)} points", f"{normals.shape}", "leave out such points"
        )
    away = (normals * points).sum(axis=1, keepdims=True) > 0
    return np.asarray(np.where(away, -normals, normals) / length)


def _in_blocks(values: Float[np.ndarray, "h w *c"], size: int) -> Float[np.ndarray, "b p *c"]:
    """Square blocks of pixels, row by row; what a block lacks at the lower and right edge is NaN."""
    height, width, tail = *values.shape[:2], values.shape[2:]
    rows, columns = -(-height // size), -(-width // size)
    whole = np.full((rows * size, columns * size, *tail), np.nan)
    whole[:height, :width] = values
    cut = whole.reshape(rows, size, columns, size, *tail).swapaxes(1, 2).reshape(rows * columns, size * size, *tail)
    return np.nan_to_num(cut) if tail else cut


def _evenly(view: Int[np.ndarray, "n"], most: int) -> Int[np.ndarray, "m"]:
    """Every so many-th ray of each view: they lie along a Morton curve, so no large gap is left."""
    edges = np.append(np.flatnonzero(np.diff(view, prepend=-1)), len(view))
    chosen = []
    for first, last in pairwise(edges.tolist()):
        count = min(max(round(most * (last - first) / len(view)), 1), last - first)
        chosen.append(first + np.linspace(0, last - first - 1, count).round().astype(np.int64))
    return np.concatenate(chosen)


def _morton(directions: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """The place of each direction along a curve that fills the view: neighbours on it are neighbours for the rays."""
    middle = directions.mean(axis=0)
    _, _, axes = np.linalg.svd(directions - middle, full_matrices=False)
    flat = (directions - middle) @ axes[:2].T
    low, size = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0).max(), 1e-12)
    cell = ((flat - low) / size * 255.999).astype(np.int64)
    code = np.zeros(len(cell), np.int64)
    for bit in range(8):
        code |= ((cell[:, 0] >> bit) & 1) << (2 * bit) | ((cell[:, 1] >> bit) & 1) << (2 * bit + 1)
    return code


def _checked(observation: Observation) -> Observation:
    """Refuses what cannot tell a pose.

    Raises:
        InputError: where the rays are too few, look along a line or into a plane, or are in another unit.
    """
    n = len(observation)
    if n < _FEWEST:
        what = "points" if observation.is_cloud else "blocks of pixels with depth"
        raise InputError(f"at least {_FEWEST} {what}", f"{n}", "give more of the frame")
    # Of directions in one plane the third singular value is 0; of a narrow but round view it is its half-width.
    if np.linalg.svd(observation.directions, compute_uv=False)[2] < _FLAT * np.sqrt(n):
        raise InputError(
            "rays all over the view",
            "rays on one line or in one plane with the camera",
            "give more of the view, in the camera's own frame, and check the intrinsics of a depth image",
        )
    scale = observation.scale
    median = float(np.median(observation.ranges))
    if scale.kind != "unknown" and not _NEAR_MM <= median * scale.factor <= _FAR_MM:
        hint = (
            "multiply by 1000 if they are in metres"
            if median * scale.factor < _NEAR_MM
            else "check the unit: what a step of a depth image is (--depth-unit-mm), or a unit of the points"
        )
        raise InputError(
            f"distances of {_NEAR_MM:g} to {_FAR_MM:g} mm", f"a median of {median * scale.factor:.3g}", hint
        )
    return observation.rows(np.lexsort((_morton(observation.directions), observation.view)))
