"""A data set as it is read: checked when it is opened, decoded when it is asked."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from naris.core.camera import Intrinsics
from naris.core.frame import Frame, Sample
from naris.core.pose import CAMERA, Pose
from naris.dataset.layout import ABOUT, SAMPLES, SCHEMA, RegionLabels, intrinsics_from_json
from naris.dataset.pictures import read_depth, read_rgb
from naris.errors import DatasetError, InputError, PoseError
from naris.render.viewpoints import FREE, Viewpoints

_READERS = 4
_NUMBERS = ("trajectory", "position")
_LARGEST = np.iinfo(np.int64).max // 2


@dataclass(frozen=True, eq=False)
class Dataset:
    """N samples on disk. `len`, `dataset[i]` (a `Sample`), and all pictures, regions and poses as arrays.

    Attributes:
        folder: where it lies.
        intrinsics: of every image.
        regions: names of the K regions and which of them touch.
        views: poses `anatomy_T_camera`, regions, trajectories and positions.
        images: the files of the pictures, one a sample.
        depths: the files of the depth pictures, or None.
        depth_scale_mm: one step of a depth picture.
        anatomy_name, anatomy_digest: what is seen; None where unknown.
        about: all of `dataset.json`; empty for the original's folders.
    """

    folder: Path
    intrinsics: Intrinsics
    regions: RegionLabels
    views: Viewpoints
    image_files: tuple[Path, ...]
    depth_files: tuple[Path, ...] | None
    depth_scale_mm: float
    anatomy_name: str | None
    anatomy_digest: str | None
    about: dict[str, Any]

    @staticmethod
    def open(folder: Path) -> Dataset:
        """Read what `naris.dataset.generate.simulate` wrote. Pictures are checked when they are read.

        Raises:
            DatasetError: if the folder is no data set, is unfinished, lacks a pose or a picture, or contradicts itself.
        """
        about = _about(folder)
        rows = _rows(folder, about)
        try:
            regions = RegionLabels.from_json(about["regions"])
            anatomy, depth = about["anatomy"], about["depth"]
            name, known_by, frame = anatomy["name"], anatomy["digest"], str(anatomy["frame"])
            scale_mm = float(depth["scale_mm"]) if depth else 0.0
            intrinsics = intrinsics_from_json(about["intrinsics"])
        except (KeyError, TypeError, ValueError, InputError) as error:
            raise DatasetError(
                f"regions, anatomy, depth and intrinsics in {ABOUT} of {folder.name}",
                f"{error!r}"
                if isinstance(error, KeyError)
                else error.got
                if isinstance(error, InputError)
                else f"{error}",
                "make the data set anew",
            ) from error
        views = _views(rows, frame, regions, folder.name)
        images = _files(folder, [row.get("image") for row in rows])
        depths = _files(folder, [row.get("depth") for row in rows]) if depth else None
        return Dataset(folder, intrinsics, regions, views, images, depths, scale_mm, name, known_by, about)

    def __len__(self) -> int:
        return len(self.image_files)

    def __getitem__(self, index: int) -> Sample:
        """Raises ImageError if the picture or its depth cannot be read."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"sample {index} of a data set of {len(self)}")
        frame = Frame(self._read(self.image_files[index]), self.intrinsics)
        depth = None if self.depth_files is None else self._depth_mm(self.depth_files[index])
        region = int(self.views.region[index])
        return Sample(frame, self.views.anatomy_T_camera[index], region, depth)

    def images(self, indices: Sequence[int] | Int[np.ndarray, "m"] | None = None) -> UInt8[np.ndarray, "n h w 3"]:
        """The pictures (all of them, or those), decoded on a few threads.

        Raises:
            ImageError: if one is missing, no PNG or of another size; the message names it.
        """
        files = self.image_files if indices is None else [self.image_files[int(i)] for i in indices]
        out = np.empty((len(files), self.intrinsics.height, self.intrinsics.width, 3), dtype=np.uint8)

        def fill(i: int) -> None:
            out[i] = self._read(files[i])

        with ThreadPoolExecutor(_READERS) as pool:
            for _ in pool.map(fill, range(len(files))):
                pass
        return out

    @property
    def labels(self) -> Int[np.ndarray, "n"]:
        """The region of each sample."""
        return self.views.region

    @property
    def anatomy_T_camera(self) -> Pose:
        """(N,) poses."""
        return self.views.anatomy_T_camera

    def _read(self, path: Path) -> UInt8[np.ndarray, "h w 3"]:
        return read_rgb(path, self.intrinsics.width, self.intrinsics.height)

    def _depth_mm(self, path: Path) -> Float32[np.ndarray, "h w"]:
        steps = read_depth(path, self.intrinsics.width, self.intrinsics.height)
        return steps.astype(np.float32) * np.float32(self.depth_scale_mm)


def _about(folder: Path) -> dict[str, Any]:
    if not (folder / ABOUT).is_file():
        got = "nothing" if not folder.exists() else f"a folder without {ABOUT}" if folder.is_dir() else "a file"
        raise DatasetError(
            f"a data set (a folder with {ABOUT}, made by naris simulate) at {folder}", got, "check the path"
        )
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"JSON in {ABOUT} of {folder}", "none that can be read", "make the data set anew") from error
    if not isinstance(about, dict) or about.get("schema") != SCHEMA:
        found = about.get("schema") if isinstance(about, dict) else type(about).__name__
        raise DatasetError(f"a data set of schema {SCHEMA}", f"{found!r} in {folder.name}", "check the path")
    return about


def _rows(folder: Path, about: dict[str, Any]) -> list[dict[str, Any]]:
    try:
        lines = (folder / SAMPLES).read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise DatasetError(
            f"text in UTF-8 in {SAMPLES} of {folder.name}", f"{error}", "make the data set anew"
        ) from error
    except OSError as error:
        raise DatasetError(
            f"a finished data set in {folder.name}", f"one without {SAMPLES}", "run the same simulation again"
        ) from error
    try:
        rows = [json.loads(line) for line in lines]
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"JSON in each row of {SAMPLES}", f"{error}", "make the data set anew") from error
    if len(rows) != about.get("count") or not all(isinstance(row, dict) for row in rows):
        raise DatasetError(
            f"{about.get('count')} rows in {SAMPLES} of {folder.name}", f"{len(rows)}", "make the data set anew"
        )
    return rows


def _views(rows: list[dict[str, Any]], frame: str, regions: RegionLabels, name: str) -> Viewpoints:
    poses_mm: list[Float[np.ndarray, "4 4"]] = []
    for i, row in enumerate(rows):
        poses_mm.append(_pose(row.get("anatomy_T_camera"), i, frame, name))
        if not (isinstance(row.get("region"), int) and -1 <= row["region"] < len(regions.names)):
            raise DatasetError(
                f"a region 0…{len(regions.names) - 1} of sample {i} in {name}",
                f"{row.get('region')!r}",
                "make the data set anew",
            )
        for key in _NUMBERS:
            number = row.get(key, FREE)
            if not (isinstance(number, int) and FREE <= number <= _LARGEST):
                raise DatasetError(f"a whole number as {key} of sample {i} in {name}", f"{number!r}", "make it anew")
    poses = Pose(np.reshape(poses_mm, (len(rows), 4, 4)), frame, CAMERA)
    columns = [np.array([row.get(key, FREE) for row in rows], dtype=np.int64) for key in ("region", *_NUMBERS)]
    return Viewpoints(poses, *columns)


def _pose(value: object, sample: int, frame: str, name: str) -> Float[np.ndarray, "4 4"]:
    """The matrix of one row, if it is a pose."""
    expected, todo = f"a pose (a rigid 4×4 matrix) of sample {sample} in {name}", "make the data set anew"
    if not isinstance(value, list):
        raise DatasetError(expected, "none", todo)
    try:
        matrix = np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise DatasetError(expected, "rows that are no four numbers each", todo) from error
    if matrix.shape != (4, 4):
        raise DatasetError(expected, f"numbers of shape {'×'.join(map(str, matrix.shape))}", todo)
    try:
        return Pose(matrix, frame, CAMERA).matrix
    except PoseError as error:
        raise DatasetError(expected, error.got, todo) from error


def _files(folder: Path, names: Sequence[object]) -> tuple[Path, ...]:
    """The files of those names, all of them there and inside the folder."""
    there = {f"{path.parent.name}/{path.name}" for path in folder.glob("*/*")}
    for i, name in enumerate(names):
        if not isinstance(name, str) or name not in there:
            raise DatasetError(f"the picture {name} of sample {i} in {folder.name}", "none", "make the data set anew")
    return tuple(folder / str(name) for name in names)
