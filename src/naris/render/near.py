"""Views that are almost the same: what a clean test must not find in the training."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from naris.core.pose import Pose
from naris.errors import PoseError

NEIGHBOUR_MM = 2.0
NEIGHBOUR_DEG = 15.0


def neighbours(of: Pose, views: Pose) -> Bool[np.ndarray, "n"]:
    """Which of N views have one of M others less than 2 mm and less than 15° (between viewing directions) off.

    The angle between the full orientations is never smaller than that between the viewing directions, so views without
    a neighbour have none in that sense either.

    Args:
        of: (M,) the others.
        views: (N,).

    Raises:
        PoseError: if the poses are in different frames.
    """
    if of.target != views.target:
        raise PoseError(f"poses in the frame {of.target!r}", f"{views.target!r}", "bring them to one frame")
    apart_mm = np.linalg.norm(views.position_mm[:, None] - of.position_mm[None], axis=-1)
    cosine = views.forward @ of.forward.T
    return ((apart_mm < NEIGHBOUR_MM) & (cosine > np.cos(np.deg2rad(NEIGHBOUR_DEG)))).any(axis=1)
