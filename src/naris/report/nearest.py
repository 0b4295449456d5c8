"""Which training view stands nearest to a test view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from naris.core.pose import Pose
from naris.errors import PoseError
from naris.report.data import NEIGHBOUR_DEG, NEIGHBOUR_MM


@dataclass(frozen=True, eq=False)
class Nearest:
    """For each of N test views its nearest training view.

    Attributes:
        index: (N,) which training view.
        distance_mm: (N,) between the centres of the two cameras.
        angle_deg: (N,) between their viewing directions.
    """

    index: Int[np.ndarray, "n"]
    distance_mm: Float[np.ndarray, "n"]
    angle_deg: Float[np.ndarray, "n"]

    @property
    def typical(self) -> int:
        """The test view that is neither near nor far: the middle one in the order of nearness."""
        order = np.argsort(_apart(self.distance_mm, self.angle_deg), kind="stable")
        return int(order[len(order) // 2])


def nearest_views(train: Pose, test: Pose) -> Nearest:
    """The training view that is nearest to each test view, where 2 mm weigh as much as 15°.

    The larger of the two parts counts, so that a test view has a neighbour among the training views (as in
    `naris.dataset.splits`) exactly if its nearest one is a neighbour.

    Raises:
        PoseError: if the poses are in different frames, or there are none.
    """
    if train.target != test.target:
        raise PoseError(f"poses in the frame {train.target!r}", f"{test.target!r}", "bring them to one frame")
    if not len(train) or not len(test):
        raise PoseError("training and test views", f"{len(train)} and {len(test)}", "give at least one of each")
    distance_mm = np.linalg.norm(test.position_mm[:, None] - train.position_mm[None], axis=-1)
    angle_deg = np.rad2deg(np.arccos(np.clip(test.forward @ train.forward.T, -1, 1)))
    index = np.argmin(_apart(distance_mm, angle_deg), axis=1)
    row = np.arange(len(index))
    return Nearest(index, distance_mm[row, index], angle_deg[row, index])


def _apart(distance_mm: Float[np.ndarray, "*n"], angle_deg: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    return np.maximum(distance_mm / NEIGHBOUR_MM, angle_deg / NEIGHBOUR_DEG)
