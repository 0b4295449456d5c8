"""COLMAP's sparse models: what their three files say, checked and brought to our conventions.

A pose takes the world to the camera (x right, y down, z forward, as ours). In COLMAP the middle of the upper left pixel
is at (0.5, 0.5), here at (0, 0). Format and camera models: colmap.github.io/format.html and /cameras.html.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from naris.core.camera import Brown, Fisheye, Intrinsics, Lens, Pinhole
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError
from naris.register.sfm.colmap_binary import read_binary
from naris.register.sfm.colmap_rows import FILES, CameraRow, ImageRow, PointRows, Rows
from naris.register.sfm.colmap_text import read_text
from naris.register.sfm.reconstruction import WORLD, Reconstruction, View

_LENSES: dict[str, tuple[int, int, Callable[..., Lens]]] = {
    "SIMPLE_PINHOLE": (1, 0, Pinhole),
    "PINHOLE": (2, 0, Pinhole),
    "SIMPLE_RADIAL": (1, 1, Brown),
    "RADIAL": (1, 2, Brown),
    "OPENCV": (2, 4, Brown),
    "OPENCV_FISHEYE": (2, 4, Fisheye),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, Fisheye),
    "RADIAL_FISHEYE": (1, 2, Fisheye),
}
"""How many focal lengths and coefficients a model has, and the lens whose first coefficients those are."""
_UNIT_TOLERANCE = 0.01
_AGAIN = "write the model again"


def is_colmap(folder: Path) -> bool:
    """Whether one of the three files lies there, text or binary."""
    return any((folder / f"{name}{suffix}").is_file() for name in FILES for suffix in (".txt", ".bin"))


def read_colmap(folder: Path) -> Reconstruction:
    """A sparse model of COLMAP.

    Args:
        folder: with `cameras`, `images` and `points3D`, all `.txt` or all `.bin`; other files are passed over.

    Raises:
        InputError: if one is missing, truncated or damaged, text and binary are mixed, a camera model is not supported,
            or the files are not of one model.
    """
    kind = _kind(folder)
    rows = read_text(folder) if kind == ".txt" else read_binary(folder)
    cameras = {row.number: _intrinsics(row) for row in rows.cameras}
    if not rows.images or not len(rows.points.numbers):
        lacking = "images" if not rows.images else "points"
        raise InputError(f"a model with images and points in {folder.name}", f"no {lacking}", "give a finished one")
    _check_finite(rows.points.positions, f"points3D{kind}")
    views = tuple(_view(row, cameras, rows, kind) for row in rows.images)
    return Reconstruction(views, rows.points.positions)


def _kind(folder: Path) -> str:
    """The suffix of all three files."""
    complete, some = [], set()
    for suffix in (".txt", ".bin"):
        there = [name for name in FILES if (folder / f"{name}{suffix}").is_file()]
        some |= {f"{name}{suffix}" for name in there}
        if len(there) == len(FILES):
            complete.append(suffix)
    if len(complete) == 1:
        return complete[0]
    expected = f"{', '.join(FILES)} in {folder.name}, all as .txt or all as .bin"
    if complete:
        raise InputError(expected, "both, which may differ", "remove one set")
    raise InputError(expected, f"{', '.join(sorted(some)) or 'none'} only", "give the folder of a whole model")


def _intrinsics(row: CameraRow) -> Intrinsics:
    if row.model not in _LENSES:
        raise InputError(
            f"a camera of COLMAP as {', '.join(_LENSES)}", row.model, "undistort the pictures with COLMAP first"
        )
    focals, coefficients, lens = _LENSES[row.model]
    if len(row.parameters) != focals + 2 + coefficients:
        raise InputError(
            f"{focals + 2 + coefficients} parameters of camera {row.number} ({row.model})",
            f"{len(row.parameters)}",
            _AGAIN,
        )
    _check_finite(np.array(row.parameters), f"camera {row.number}")
    cx, cy = row.parameters[focals : focals + 2]
    made = lens(*row.parameters[focals + 2 :])
    return Intrinsics(row.width, row.height, row.parameters[0], row.parameters[focals - 1], cx - 0.5, cy - 0.5, made)


def _view(row: ImageRow, cameras: dict[int, Intrinsics], rows: Rows, kind: str) -> View:
    if row.camera not in cameras:
        raise InputError(
            f"camera {row.camera} of the image {row.name}", f"none in cameras{kind}", "give files of one model"
        )
    return View(row.name, _pose(row), cameras[row.camera], _seen(row, rows.points, kind))


def _pose(row: ImageRow) -> Pose:
    """COLMAP's quaternions begin with the real part."""
    from scipy.spatial.transform import Rotation

    numbers = np.array([*row.quaternion, *row.translation])
    _check_finite(numbers, f"the pose of {row.name}")
    length = float(np.linalg.norm(row.quaternion))
    if abs(length - 1) > _UNIT_TOLERANCE:
        raise InputError(f"a quaternion of length 1 for the image {row.name}", f"{length:.3g}", _AGAIN)
    return Pose.of(Rotation.from_quat(row.quaternion, scalar_first=True).as_matrix(), numbers[4:], CAMERA, WORLD)


def _seen(row: ImageRow, points: PointRows, kind: str) -> Int[np.ndarray, "k"]:
    """Where the points that an image saw stand among all."""
    wanted = np.unique(row.points[row.points >= 0])
    numbers, order = points.numbers, points.order
    at = order[np.minimum(np.searchsorted(numbers, wanted, sorter=order), len(numbers) - 1)]
    missing = wanted[numbers[at] != wanted]
    if len(missing):
        raise InputError(
            f"the points of the image {row.name} in points3D{kind}",
            f"{len(missing)} of {len(wanted)} missing",
            "give files of one model",
        )
    return at


def _check_finite(numbers: Float[np.ndarray, "..."], where: str) -> None:
    if not np.isfinite(numbers).all():
        raise InputError(f"finite numbers in {where}", "NaN or infinity", _AGAIN)
