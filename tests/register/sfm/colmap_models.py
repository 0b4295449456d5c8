"""COLMAP models as COLMAP writes them, text and binary, of a plain description."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from naris.core.camera import Intrinsics
from naris.register.sfm.reconstruction import Reconstruction

MODELS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4, "OPENCV_FISHEYE": 5}
MODELS |= {"FULL_OPENCV": 6, "FOV": 7, "SIMPLE_RADIAL_FISHEYE": 8, "RADIAL_FISHEYE": 9}


@dataclass(frozen=True)
class Model:
    """Rows as the format documents them.

    Attributes:
        cameras: number, model, width, height, parameters.
        images: number, quaternion (w, x, y, z), translation, camera, name, features (x, y, number of a point).
        points: number and position.
    """

    cameras: list[tuple[int, str, int, int, list[float]]]
    images: list[tuple[int, list[float], list[float], int, str, list[tuple[float, float, int]]]]
    points: list[tuple[int, list[float]]]

    def track(self, point):
        return [(image[0], at) for image in self.images for at, feature in enumerate(image[5]) if feature[2] == point]


def write_text(model: Model, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    words = [[n, name, w, h, *map(repr, parameters)] for n, name, w, h, parameters in model.cameras]
    _lines(folder / "cameras.txt", words)
    rows = []
    for number, q, t, camera, name, features in model.images:
        rows += [[number, *map(repr, [*q, *t]), camera, name], [word for one in features for word in one]]
    _lines(folder / "images.txt", rows)
    points = [
        [number, *map(repr, xyz), 9, 99, 200, 0.5, *(word for one in model.track(number) for word in one)]
        for number, xyz in model.points
    ]
    _lines(folder / "points3D.txt", points)
    return folder


def write_binary(model: Model, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    cameras = struct.pack("<Q", len(model.cameras))
    for number, name, width, height, parameters in model.cameras:
        cameras += struct.pack(f"<IiQQ{len(parameters)}d", number, MODELS[name], width, height, *parameters)
    images = struct.pack("<Q", len(model.images))
    for number, q, t, camera, name, features in model.images:
        images += struct.pack("<I7dI", number, *q, *t, camera) + name.encode() + b"\0"
        images += struct.pack("<Q", len(features)) + b"".join(struct.pack("<ddq", *one) for one in features)
    points = struct.pack("<Q", len(model.points))
    for number, xyz in model.points:
        track = model.track(number)
        points += struct.pack("<Q3d3BdQ", number, *xyz, 9, 99, 200, 0.5, len(track))
        points += b"".join(struct.pack("<II", *one) for one in track)
    for name, content in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.bin").write_bytes(content)
    return folder


def model_of(reconstruction: Reconstruction) -> Model:
    """The model that COLMAP would have made of it; pinhole cameras only."""
    from scipy.spatial.transform import Rotation

    images = []
    for number, view in enumerate(reconstruction.views, 1):
        inside = view.camera_T_world.apply(reconstruction.points[view.seen])
        pixels = view.intrinsics.project(inside)[0] + 0.5
        features = [(*map(float, xy), 10 * int(at) + 7) for xy, at in zip(pixels, view.seen, strict=True)]
        q = Rotation.from_matrix(view.camera_T_world.rotation).as_quat(scalar_first=True)
        images.append((number, q.tolist(), view.camera_T_world.position_mm.tolist(), 1, view.name, features))
    points = [(10 * at + 7, xyz) for at, xyz in enumerate(reconstruction.points.tolist())]
    return Model([_camera(reconstruction.views[0].intrinsics)], images, points)


def _camera(camera: Intrinsics) -> tuple[int, str, int, int, list[float]]:
    parameters = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5]
    return 1, "PINHOLE", camera.width, camera.height, np.array(parameters).tolist()


def _lines(path: Path, rows: list[list]) -> None:
    text = "".join(" ".join(map(str, row)) + "\n" for row in rows)
    path.write_text(f"# as COLMAP writes it\n# Number: {len(rows)}\n{text}", encoding="utf-8")
