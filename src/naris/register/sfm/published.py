"""The published format of structure from motion in endoscopy (Liu et al. 2019, EndoscopyDepthEstimation-Pytorch).

`motion.yaml` has a pose for each number in `visible_view_indexes`. It takes the camera to the world: only so do the
pictures agree where one point is seen in several (`tests/register/sfm/test_published.py`).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from naris.anatomy.ply import read_ply_points
from naris.core.camera import Intrinsics
from naris.core.pictures import read_picture
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError
from naris.register.files import content_of
from naris.register.sfm.reconstruction import WORLD, Reconstruction, View

MOTION, STRUCTURE, VIEWS = "motion.yaml", "structure.ply", "visible_view_indexes"
SIGHTINGS, CAMERAS, MASK = "view_indexes_per_point", "camera_intrinsics_per_view", "undistorted_mask"
_MASKS = (".bmp", ".png", ".jpg")
_FIELDS = {"position": "xyz", "orientation": "xyzw"}
_LINE = re.compile(r"\s*([\w\[\]]+):\s*(\S*)\s*")
_POSE = re.compile(r"poses\[\d+\]")
_UNIT_TOLERANCE = 0.01
_OF_CAMERA = 4
_AGAIN = "copy the folder again"


def is_published(folder: Path) -> bool:
    """Whether there are motion and structure."""
    return (folder / MOTION).is_file() or (folder / STRUCTURE).is_file()


def read_published(folder: Path) -> Reconstruction:
    """A reconstruction in the published format; its views are named by their numbers.

    Args:
        folder: with `motion.yaml`, `structure.ply`, `visible_view_indexes`, `view_indexes_per_point`,
            `camera_intrinsics_per_view`, and `undistorted_mask` for the size of the pictures.

    Raises:
        InputError: if one is missing or damaged, or they are not of one reconstruction.
    """
    points = read_ply_points(folder / STRUCTURE, content_of(folder / STRUCTURE, (".ply",), "points"))
    if not np.isfinite(points).all():
        raise InputError(f"finite points in {STRUCTURE}", "NaN or infinity", "leave them out")
    numbers = [int(number) for number in _numbers(folder / VIEWS, whole=True)]
    world_T_camera = _motion(folder / MOTION)
    if len(world_T_camera) != len(numbers) or len(set(numbers)) != len(numbers):
        raise InputError(
            f"a pose in {MOTION} for each number in {VIEWS}", f"{len(world_T_camera)} for {len(numbers)}", _AGAIN
        )
    intrinsics = _intrinsics(folder, len(numbers))
    seen = _seen(folder / SIGHTINGS, numbers, len(points))
    camera_T_world = world_T_camera.inverse()
    views = tuple(
        View(str(number), camera_T_world[i], intrinsics[i], np.array(seen[number], dtype=np.int64))
        for i, number in enumerate(numbers)
    )
    return Reconstruction(views, points)


def _motion(path: Path) -> Pose:
    """The poses, as a dump of a ROS message has them: position, and a quaternion that ends with the real part."""
    from scipy.spatial.transform import Rotation

    poses: list[dict[str, float]] = []
    field = ""
    for number, line in enumerate(_text(path).splitlines(), 1):
        found = _LINE.fullmatch(line)
        key, value = found.groups() if found else ("", "")
        if _POSE.fullmatch(key):
            poses.append({})
        elif key in _FIELDS:
            field = key
        elif poses and key and key in _FIELDS.get(field, ""):
            poses[-1][f"{field}.{key}"] = _number(value, path, number)
    wanted = [f"{name}.{axis}" for name, axes in _FIELDS.items() for axis in axes]
    if not poses or any(set(pose) != set(wanted) for pose in poses):
        got = (
            f"less in pose {next((i for i, one in enumerate(poses) if len(one) < len(wanted)), 0)}" if poses else "none"
        )
        raise InputError(f"poses with position and orientation in {path.name}", got, _AGAIN)
    rows = np.array([[pose[name] for name in wanted] for pose in poses])
    length = np.linalg.norm(rows[:, 3:], axis=1)
    if (np.abs(length - 1) > _UNIT_TOLERANCE).any():
        raise InputError(
            f"quaternions of length 1 in {path.name}", f"{length[np.argmax(np.abs(length - 1))]:.3g}", _AGAIN
        )
    return Pose.of(Rotation.from_quat(rows[:, 3:]).as_matrix(), rows[:, :3], WORLD, CAMERA)


def _seen(path: Path, views: list[int], points: int) -> dict[int, list[int]]:
    """Which points each view saw; the file has the views of each point behind a −1."""
    words = _numbers(path, whole=True)
    starts = np.flatnonzero(words == -1)
    if len(starts) != points or words[0] != -1:
        raise InputError(
            f"−1 before the views of each of {points} points in {path.name}", f"{len(starts)} times", _AGAIN
        )
    seen: dict[int, list[int]] = {view: [] for view in views}
    point = np.cumsum(words == -1) - 1
    for view, of in zip(words.astype(int).tolist(), point.tolist(), strict=True):
        if view == -1:
            continue
        if view not in seen:
            raise InputError(f"views of {VIEWS} in {path.name}", f"{view}", _AGAIN)
        seen[view].append(of)
    return seen


def _intrinsics(folder: Path, views: int) -> list[Intrinsics]:
    """Of each view; the file has them once or for each."""
    numbers = _numbers(folder / CAMERAS)
    if len(numbers) not in (_OF_CAMERA, _OF_CAMERA * views):
        raise InputError(
            f"fx, fy, cx and cy in {CAMERAS}, once or for each of {views} views", f"{len(numbers)} numbers", _AGAIN
        )
    masks = [folder / f"{MASK}{suffix}" for suffix in _MASKS if (folder / f"{MASK}{suffix}").is_file()]
    if not masks:
        raise InputError(f"{MASK}{' or '.join(_MASKS)} in {folder.name}", "none", "add it: it tells the pictures' size")
    height, width, _ = read_picture(masks[0]).shape
    rows = np.resize(numbers, (views, _OF_CAMERA)).tolist()
    return [Intrinsics(width, height, *row) for row in rows]


def _numbers(path: Path, *, whole: bool = False) -> Float[np.ndarray, "n"]:
    """One in each line."""
    found = np.array([_number(word, path, n) for n, word in enumerate(_text(path).split(), 1)])
    if not len(found) or (whole and (found != np.rint(found)).any()):
        raise InputError(f"{'whole ' if whole else ''}numbers in {path.name}", "something else", _AGAIN)
    return found


def _number(word: str, path: Path, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"a finite number in line {line} of {path.name}", repr(word[:40]), _AGAIN)
    return value


def _text(path: Path) -> str:
    try:
        return content_of(path, (path.suffix,), "a part of a reconstruction").decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"text in {path.name}", "other bytes", _AGAIN) from error
