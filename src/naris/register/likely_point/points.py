"""A cloud of points registered to a surface: ICP, IMLP and IMLOP, one function for all of them.

Far from the answer the pose is what is wrong, and matches are as likely as that allows: as in the papers the mean
square that is left beyond the noise is added to it. Here it can only fall, and is none in the end.

With `PointsConfig.average` the last steps maximise the likelihood of the points alone, the places that they were seen
of integrated over the surface (`naris.register.likely_point.average`): better where the noise is as large as the folds
of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from naris.core.pose import Pose
from naris.errors import InputError, PoseError
from naris.register.likely_point.likelihood import Cloud, Likelihood
from naris.register.likely_point.noise import CloudNoise, axes_of
from naris.register.likely_point.solve import PointsConfig, solve
from naris.register.likely_point.surface import Surface

Method = Literal["icp", "imlp", "imlop"]
METHODS: tuple[Method, ...] = ("icp", "imlp", "imlop")
_FEWEST = 6


@dataclass(frozen=True, eq=False)
class PointRegistration:
    """Where the registration of a cloud ended.

    Attributes:
        surface_T_points: from the frame of the cloud to that of the surface.
        converged: whether it stood still before its steps were used up.
        iterations: steps that were tried.
        cost: −log likelihood of the cloud but for constants, at the noise that was said, averaged or not.
        mean_distance_mm: of the points from their matches.
        matches_mm: (N, 3) on the surface, in its frame.
        faces: (N,) that they lie in.
        outliers: how many points count less than half.
        covariance: (6, 6) of the twist in the frame of the cloud (mm, rad), if the basin is right.
    """

    surface_T_points: Pose
    converged: bool
    iterations: int
    cost: float
    mean_distance_mm: float
    matches_mm: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "n"]
    outliers: int
    covariance: Float[np.ndarray, "6 6"]


def register_points(
    points_mm: Float[np.ndarray, "n 3"],
    surface: Surface,
    start: Pose,
    noise: CloudNoise,
    *,
    normals: Float[np.ndarray, "n 3"] | None = None,
    method: Method = "imlp",
    config: PointsConfig = PointsConfig(),
) -> PointRegistration:
    """The most likely pose of a cloud near a start, each point matched with the most likely point of the surface.

    `icp` (Besl and McKay 1992) takes the same error in every direction, so that the nearest point is the match; `imlp`
    (Billings, Boctor and Taylor 2015) the covariance of each point; `imlop` (Billings and Taylor 2014; with
    eccentricity their generalised G-IMLOP of 2015) that of its normal as well. All end where the likelihood of points
    and matches together has its maximum; Levenberg–Marquardt leads there, with a step taken only if the likelihood of
    the new pose, matched anew, is higher.

    Args:
        points_mm: (N, 3), in a frame of their own.
        surface: what they lie on (`surface_of`).
        start: `surface_T_points`.
        noise: of the points, in their frame.
        normals: (N, 3) unit, to the side that those of the surface are to; for `imlop`.
        method: which noise is looked at.
        config: how long is tried.

    Raises:
        InputError: if the points are fewer than six, points, normals and noise do not fit each other, or the triangles
            are too large to average over.
        PoseError: if the start is not one pose into the frame of the surface.
    """
    points = _checked(points_mm, surface, start, method, normals)
    middle = points.mean(axis=0)
    seen = _seen(points - middle, noise, normals, method)
    pose = (start @ Pose.of(np.eye(3), middle, start.source, start.source)).matrix.copy()
    pose, at, converged, iterations = solve(surface.tree, seen, pose, config)
    surface_T_points = pose @ Pose.of(np.eye(3), -middle, start.source, start.source).matrix
    found = Pose(surface_T_points, surface.frame, start.source)
    return PointRegistration(
        surface_T_points=found,
        converged=converged,
        iterations=iterations,
        cost=at.cost,
        mean_distance_mm=float(np.linalg.norm(at.places - found.apply(points), axis=1).mean()),
        matches_mm=at.places,
        faces=surface.face_ids[at.found.rows],
        outliers=int((at.counts < 0.5).sum()),
        covariance=_covariance(at, middle),
    )


def _checked(
    points_mm: Float[np.ndarray, "n 3"],
    surface: Surface,
    start: Pose,
    method: Method,
    normals: Float[np.ndarray, "n 3"] | None,
) -> Float[np.ndarray, "n 3"]:
    points = np.asarray(points_mm, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < _FEWEST or not np.isfinite(points).all():
        raise InputError(f"at least {_FEWEST} finite points (N, 3)", f"{points.shape}", "give a cloud of points")
    if method not in METHODS:
        raise InputError(f"a method among {', '.join(METHODS)}", repr(method), "name one of those")
    if method == "imlop" and normals is None:
        raise InputError("normals with the method imlop", "none", "give them, or take imlp")
    if start.target != surface.frame or start.shape:
        raise PoseError(
            f"one pose into {surface.frame}", f"{start.shape} into {start.target}", "begin in the surface's frame"
        )
    return points


def _seen(
    points: Float[np.ndarray, "n 3"], noise: CloudNoise, normals: Float[np.ndarray, "n 3"] | None, method: Method
) -> Cloud:
    """What the method looks at of points, normals and noise."""
    if method == "icp":
        mean = float(np.trace(noise.covariance_mm2, axis1=-2, axis2=-1).mean()) / 3
        noise = CloudNoise(mean * np.eye(3), farthest_sd=noise.farthest_sd)
    used = normals if method == "imlop" else None
    return Cloud(points, axes_of(noise, len(points), used), noise.farthest_sd)


def _covariance(at: Likelihood, middle: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 6"]:
    """Of the twist about the origin of the cloud's frame, from that about its middle."""
    about_middle = np.linalg.inv(at.matrix + 1e-12 * np.eye(6))
    x, y, z = middle
    move = np.eye(6)
    move[:3, 3:] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(move @ about_middle @ move.T)
