"""COLMAP's binary files, little-endian, byte by byte; nothing is allocated before it is there."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from naris.errors import InputError
from naris.register.files import content_of
from naris.register.sfm.colmap_rows import FILES, CameraRow, ImageRow, PointRows, Rows, damaged

_MODELS = (
    ("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8), ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12), ("FOV", 5), ("SIMPLE_RADIAL_FISHEYE", 4), ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12),
)  # fmt: skip
"""Names and numbers of parameters, by the number that stands in the file."""
_FEATURE = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<i8")])
_TRACK_BYTES = 8


def read_binary(folder: Path) -> Rows:
    """What `cameras.bin`, `images.bin` and `points3D.bin` hold.

    Raises:
        InputError: if a file ends too early or too late, or a camera is of a model without a name here.
    """
    cameras, images, points = (folder / f"{name}.bin" for name in FILES)
    return Rows(_cameras(_Bytes(cameras)), _images(_Bytes(images)), _points(_Bytes(points)))


class _Bytes:
    """A file from front to back."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._content, self._at = content_of(path, (".bin",), "a model of COLMAP"), 0

    def take(self, form: str) -> tuple[Any, ...]:
        return struct.unpack(f"<{form}", self.some(struct.calcsize(f"<{form}")))

    def some(self, count: int) -> bytes:
        if count > len(self._content) - self._at:
            raise damaged(self.path, "a whole model", f"a file that ends at byte {len(self._content):,}")
        self._at += count
        return self._content[self._at - count : self._at]

    def word(self) -> str:
        """Up to a zero byte."""
        end = self._content.find(b"\0", self._at)
        if end < 0:
            raise damaged(self.path, "a whole model", f"a file that ends at byte {len(self._content):,}")
        try:
            return self.some(end + 1 - self._at)[:-1].decode("utf-8")
        except UnicodeDecodeError as error:
            raise damaged(self.path, "names in UTF-8", "other bytes") from error

    def end(self) -> None:
        rest = len(self._content) - self._at
        if rest:
            raise damaged(self.path, "a model and nothing behind it", f"{rest:,} more bytes")


def _cameras(file: _Bytes) -> tuple[CameraRow, ...]:
    rows = []
    for _ in range(file.take("Q")[0]):
        number, model, width, height = file.take("IiQQ")
        if not 0 <= model < len(_MODELS):
            raise InputError(
                f"a camera model from 0 to {len(_MODELS) - 1} in {file.path.name}",
                f"{model}",
                "undistort the pictures with COLMAP first",
            )
        name, count = _MODELS[model]
        rows.append(CameraRow(number, name, width, height, file.take(f"{count}d")))
    file.end()
    return tuple(rows)


def _images(file: _Bytes) -> tuple[ImageRow, ...]:
    rows = []
    for _ in range(file.take("Q")[0]):
        _, *pose, camera = file.take("I7dI")
        name, (count,) = file.word(), file.take("Q")
        features = np.frombuffer(file.some(count * _FEATURE.itemsize), _FEATURE)
        rows.append(ImageRow(name, tuple(pose[:4]), tuple(pose[4:]), camera, features["point"].astype(np.int64)))
    file.end()
    return tuple(rows)


def _points(file: _Bytes) -> PointRows:
    numbers, positions = [], []
    for _ in range(file.take("Q")[0]):
        number, *position = file.take("Q3d3xd")[:4]
        file.some(file.take("Q")[0] * _TRACK_BYTES)
        if number >= 2**63:
            raise damaged(file.path, "numbers of points below 2^63", f"{number}")
        numbers.append(number)
        positions.append(position)
    file.end()
    return PointRows(np.array(numbers, dtype=np.int64), np.array(positions, dtype=np.float64).reshape(-1, 3))
