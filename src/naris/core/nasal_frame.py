"""Coordinates that mean the same in every nose: so many mm in from the nostrils, to the left, and up.

The origin lies between the nostrils. "In" runs along the nasal floor to the choanae, "left" from the right side to the
left, "up" at right angles to both. The line from the nostrils to the choanae rises above the floor, by about 15° in an
adult (12 to 20° in noses drawn from the normal ranges), and no landmark tells the floor's slope as surely as that line
does, so "in" is that line turned down by 15°: how the head lay in the scanner does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.errors import InputError

RISE_DEG = 15.0
LANDMARKS = ("left.nostril", "right.nostril", "left.choana", "right.choana")
_LEAST_MM = 1.0


@dataclass(frozen=True, eq=False)
class NasalFrame:
    """The frame of one nose.

    Attributes:
        origin_mm: (3,) between the nostrils, in the frame of the anatomy.
        axes: (3, 3) whose columns are left, in and up, at right angles.
        depth_mm: from the nostrils to the choanae along "in".
    """

    origin_mm: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    depth_mm: float

    @staticmethod
    def of(landmarks_mm: Mapping[str, Float[np.ndarray, "3"]]) -> NasalFrame:
        """From both nostrils and both choanae.

        Raises:
            InputError: if one of them is missing, or they do not tell the axes.
        """
        missing = [name for name in LANDMARKS if name not in landmarks_mm]
        if missing:
            hint = "give an anatomy from a scan (naris anatomy from-ct) or the built-in nose"
            raise InputError(f"the landmarks {', '.join(LANDMARKS)}", f"no {', '.join(missing)}", hint)
        left, right = (
            np.stack([landmarks_mm[f"{side}.{name}"] for name in ("nostril", "choana")]) for side in ("left", "right")
        )
        origin, choanae = (left + right) / 2
        line, across = choanae - origin, (left - right).mean(axis=0)
        up = np.cross(across, line)
        if min(np.linalg.norm(line), np.linalg.norm(across)) < _LEAST_MM or not np.linalg.norm(up) > 1e-6:
            raise InputError("nostrils and choanae apart from each other", "points on one line", "check the landmarks")
        line, up = line / np.linalg.norm(line), up / np.linalg.norm(up)
        lateral = np.cross(line, up)
        down = np.deg2rad(RISE_DEG)
        inwards = np.cos(down) * line - np.sin(down) * up
        axes = np.stack([lateral, inwards, np.cross(lateral, inwards)], axis=1)
        return NasalFrame(origin, axes, float((choanae - origin) @ inwards))

    @property
    def frame_T_nasal(self) -> Float[np.ndarray, "4 4"]:
        """From (left, in, up) in mm to the frame of the anatomy."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.axes, self.origin_mm
        return matrix

    def coordinates_mm(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """(left, in, up) of points (..., 3) in the frame of the anatomy."""
        return np.asarray((np.asarray(points_mm) - self.origin_mm) @ self.axes)

    def points_mm(self, coordinates_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """The inverse of `coordinates_mm`."""
        return np.asarray(np.asarray(coordinates_mm) @ self.axes.T + self.origin_mm)
