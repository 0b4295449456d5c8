"""Finalists of the search solved by another method: clouds of points to the walls, in the place of rays."""

from __future__ import annotations

from typing import Literal, cast

import numpy as np
from jaxtyping import Float

from naris.core.pose import CAMERA, Pose
from naris.errors import InputError
from naris.register.libraries import LIBRARIES, library_for
from naris.register.likely_point.noise import CloudNoise
from naris.register.likely_point.points import METHODS, Method, register_points
from naris.register.likely_point.solve import PointsConfig
from naris.register.likely_point.surface import surface_of
from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.solve import Solutions, judged
from naris.register.starts import Starts

_FARTHEST_SD = 3.5
_NEAR = PointsConfig(steps=40, still_mm=1e-3, still_rad=1e-4, anneal=False)


Solver = Literal["naris", "icp", "imlp", "imlop", "small_gicp", "small_gicp_planes", "open3d"]
"""Ours by rays; ours by points (`naris.register.likely_point`); libraries (`naris.register.libraries`)."""
_LIBRARIES = {name.lower(): name for name in LIBRARIES}


def by_points(at: RegistrationMap, observation: Observation, starts: Starts, method: Solver) -> Solutions:
    """Each start solved by `register_points` or a library, then judged as all solutions are, by the rays.

    Raises:
        InputError: if there is no such method, the scale is not known, which moves of points to walls cannot tell, or
            normals are asked for that there are not.
        MachineError: if the library is not installed.
    """
    if method not in (*METHODS, *_LIBRARIES):
        raise InputError(f"a method among naris, {', '.join((*METHODS, *_LIBRARIES))}", repr(method), "name one")
    if observation.scale.free:
        raise InputError(
            f"a known scale for the method {method}", f"one that is {observation.scale.kind}", "take the method naris"
        )
    if method == "imlop" and observation.normals is None:
        raise InputError("normals for the method imlop", "none", "give them with the points, or take imlp")
    points = observation.origins + observation.ranges[:, None] * observation.directions
    if method in _LIBRARIES:
        align = library_for(_LIBRARIES[method], at.anatomy)(points)
        poses = [align(start) for start in starts.poses]
    else:
        poses = _by_ours(at, observation, points, starts, cast(Method, method))
    return judged(at, observation, Starts(np.stack(poses), starts.log_scales))


def _by_ours(
    at: RegistrationMap, observation: Observation, points: Float[np.ndarray, "n 3"], starts: Starts, method: Method
) -> list[Float[np.ndarray, "4 4"]]:
    surface, noise, frame = surface_of(at.anatomy), cloud_noise(observation), at.anatomy.frame
    # The normals of an anatomy point out of its surface, those that were seen into the air.
    normals = None if observation.normals is None else at.inside * observation.normals
    return [
        np.array(
            register_points(
                points, surface, Pose(start, frame, CAMERA), noise, normals=normals, method=method, config=_NEAR
            ).surface_T_points.matrix
        )
        for start in starts.poses
    ]


def cloud_noise(observation: Observation) -> CloudNoise:
    """Errors along the rays, the smooth one counted as each point's own, and those in every direction."""
    along = np.hypot(observation.radial, observation.smooth * observation.ranges)
    rays = observation.directions
    covariance = np.square(along)[:, None, None] * rays[:, :, None] * rays[:, None, :]
    covariance += np.square(observation.isotropic)[:, None, None] * np.eye(3)
    # What is not known of normals is not looked at.
    kappa = observation.normals_rad**-2 if np.isfinite(observation.normals_rad) else 1.0
    return CloudNoise(covariance, kappa, farthest_sd=_FARTHEST_SD)
