"""What the files of a COLMAP model hold, whether text or binary told it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from naris.errors import InputError

FILES = ("cameras", "images", "points3D")


@dataclass(frozen=True)
class CameraRow:
    """A camera: its number, the name of its model, the size of its pictures in pixels, and its parameters."""

    number: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ImageRow:
    """A picture: its name, the rotation (w, x, y, z) and translation from the world to its camera, and what it saw.

    Attributes:
        name: of the picture's file.
        quaternion, translation: `camera_T_world`.
        camera: number of its camera.
        points: (K,) numbers of the points that its features belong to, −1 for none.
    """

    name: str
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int
    points: Int[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class PointRows:
    """All points: numbers (N,) and positions (N, 3) in the world."""

    numbers: Int[np.ndarray, "n"]
    positions: Float[np.ndarray, "n 3"]

    @cached_property
    def order(self) -> Int[np.ndarray, "n"]:
        """That their numbers rise in: sorted once for all images."""
        return np.argsort(self.numbers)


@dataclass(frozen=True, eq=False)
class Rows:
    """All three files.

    Raises:
        InputError: if two cameras or points share a number, or two images a name.
    """

    cameras: tuple[CameraRow, ...]
    images: tuple[ImageRow, ...]
    points: PointRows

    def __post_init__(self) -> None:
        for what, names in (
            ("cameras of different numbers", [row.number for row in self.cameras]),
            ("images of different names", [row.name for row in self.images]),
            ("points of different numbers", self.points.numbers.tolist()),
        ):
            if len(set(names)) != len(names):
                raise InputError(what, "some twice", "write the model again")


def damaged(path: Path, expected: str, got: str) -> InputError:
    """For a file that does not hold what it should."""
    return InputError(f"{expected} in {path.name}", got, "copy it again, or write the model again")
