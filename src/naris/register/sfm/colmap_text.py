"""COLMAP's text files, line by line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from naris.register.files import content_of
from naris.register.sfm.colmap_rows import FILES, CameraRow, ImageRow, PointRows, Rows, damaged

_LONGEST = 60


def read_text(folder: Path) -> Rows:
    """What `cameras.txt`, `images.txt` and `points3D.txt` hold.

    Raises:
        InputError: if a line is not what the format says.
    """
    cameras, images, points = (folder / f"{name}.txt" for name in FILES)
    return Rows(_cameras(cameras), _images(images), _points(points))


def _cameras(path: Path) -> tuple[CameraRow, ...]:
    rows = []
    for number, line in _lines(path):
        words = line.split()
        try:
            size, parameters = [int(word) for word in words[2:4]], [float(word) for word in words[4:]]
            rows.append(CameraRow(int(words[0]), words[1], size[0], size[1], tuple(parameters)))
        except (ValueError, IndexError) as error:
            raise _wrong(path, number, "a number, a model, a size and parameters", line) from error
    return tuple(rows)


def _images(path: Path) -> tuple[ImageRow, ...]:
    """Two lines each; the second, of features, may be empty."""
    rows, lines = [], _lines(path, keep_empty=True)
    for number, line in lines:
        if not line:
            continue
        words = line.split(maxsplit=9)
        _, features = next(lines, (0, ""))
        try:
            pose = tuple(float(word) for word in words[1:8])
            camera, name = int(words[8]), words[9]
            rows.append(ImageRow(name, pose[:4], pose[4:], camera, _points_of(features)))
        except (ValueError, IndexError, OverflowError) as error:
            raise _wrong(path, number, "a pose, a camera and a name, then a line of features", line) from error
    return tuple(rows)


def _points_of(features: str) -> np.ndarray:
    """Every third word."""
    words = features.split()
    if len(words) % 3:
        raise ValueError("features are x, y and the number of a point")
    return np.array([int(word) for word in words[2::3]], dtype=np.int64)


def _points(path: Path) -> PointRows:
    numbers, positions = [], []
    for number, line in _lines(path):
        words = line.split(maxsplit=4)
        try:
            numbers.append(int(words[0]))
            positions.append([float(word) for word in words[1:4]])
            if len(words) < 5 or not -1 < numbers[-1] < 2**63:
                raise ValueError("no more than a position")
        except (ValueError, IndexError) as error:
            raise _wrong(path, number, "a number, a position, a colour, an error and a track", line) from error
    return PointRows(np.array(numbers, dtype=np.int64), np.array(positions, dtype=np.float64).reshape(-1, 3))


def _lines(path: Path, *, keep_empty: bool = False) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, without comments."""
    try:
        text = content_of(path, (".txt",), "a model of COLMAP").decode("utf-8")
    except UnicodeDecodeError as error:
        raise damaged(path, "text", "other bytes") from error
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if not stripped.startswith("#") and (stripped or keep_empty):
            yield number, stripped


def _wrong(path: Path, number: int, expected: str, line: str) -> Exception:
    return damaged(path, f"{expected} in line {number}", repr(line[:_LONGEST]))
