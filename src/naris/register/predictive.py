"""What a cloud would look like if the best pose, the anatomy and the noise were right, and how much dearer it is.

A posterior predictive check (Gelman, Meng and Stern 1996, Statistica Sinica 6): what points cost depends on what lies
around them, so that no number of noise as said can be written down; it is drawn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.rays import REACH, cast_rays, memory_for, prepared, ranges_met
from naris.register.solve import Solutions, judged
from naris.register.starts import Starts

_DRAWS = 3
_LEAST = 0.01  # of the reach: no outlier lies in the camera


def surprise(at: RegistrationMap, observation: Observation, solutions: Solutions, rng: np.random.Generator) -> float:
    """How much more the points cost at the best pose than points that are drawn there, in −2 log likelihood over √N."""
    best = Starts(solutions.poses[:1], solutions.log_scales[:1])
    drawn = [judged(at, drawn_again(at, observation, best, rng), best).costs[0] for _ in range(_DRAWS)]
    # Judged anew, for what solutions cost counts the belief in their region.
    return float((judged(at, observation, best).costs[0] - np.mean(drawn)) * np.sqrt(solutions.rays))


def drawn_again(at: RegistrationMap, observation: Observation, best: Starts, rng: np.random.Generator) -> Observation:
    """The wall along each point's ray with noise as said, and outliers; where the ray meets none, an outlier too."""
    scale = float(np.exp(best.log_scales[0]))
    rays = prepared(at, observation, fine=False).rays
    memory = memory_for(rays)
    cast_rays(at.embree, rays, best.poses[0], scale, memory)
    n, wall = len(observation), ranges_met(rays, memory) / scale
    met = np.isfinite(wall)
    points = observation.directions * np.where(met, wall, 0.0)[:, None]
    points += observation.isotropic[:, None] * rng.standard_normal((n, 3))
    is_outlier = (rng.random(n) < observation.outliers) | ~met
    reach = REACH * float(np.median(observation.ranges))
    anywhere = reach * rng.uniform(_LEAST, 1.0, n)
    points[is_outlier] = observation.directions[is_outlier] * anywhere[is_outlier, None]
    ranges = np.maximum(np.linalg.norm(points, axis=1), _LEAST * reach)
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    return replace(observation, directions=directions, ranges=ranges)
