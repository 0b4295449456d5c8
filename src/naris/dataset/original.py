"""The original's folders: `frame/NN.png` beside `pose/NN.txt`, paired by name, both ways.

The code published with Sinha et al. 2018 pairs two unsorted directory listings, so its labels may be scrambled; here a
picture and a pose belong together when their names without suffix are the same.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from naris.core.anatomy import RegionSet
from naris.core.atomic import PART, replacing, write_text
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, stack
from naris.dataset.layout import RegionLabels
from naris.dataset.read import Dataset
from naris.errors import DatasetError, KeyframeError
from naris.render.keyframes import natural_order, original_pose_text, read_original_pose
from naris.render.viewpoints import FREE, Viewpoints

FRAMES = "frame"
POSES = "pose"
ORIGINAL_INTRINSICS = Intrinsics.from_vertical_fov(300, 300, 45.0)
"""300×300 pixels, `gluPerspective` of 45°."""


def read_original(
    folder: Path, regions: RegionSet, intrinsics: Intrinsics = ORIGINAL_INTRINSICS, frame: str | None = None
) -> Dataset:
    """Open a folder of the original, in the natural order of its names.

    Args:
        folder: with `frame/` and `pose/` in it.
        regions: to label the poses with.
        intrinsics: of the pictures; the files do not say.
        frame: of the poses; that of the regions when None.

    Raises:
        DatasetError: if a folder is missing, there are no pictures, a picture has no pose or a pose no picture (the
            message names them), or a pose cannot be read.
    """
    pictures, poses = _by_name(folder, FRAMES, "*.png"), _by_name(folder, POSES, "*.txt")
    if not pictures:
        raise DatasetError(f"pictures in {FRAMES}/ of {folder.name}", "none", "check the path")
    _refuse_widows(pictures, poses, folder)
    stems = sorted(pictures, key=lambda stem: natural_order(pictures[stem]))
    try:
        anatomy_T_camera = stack([read_original_pose(poses[stem], frame or regions.frame) for stem in stems])
    except KeyframeError as error:
        raise DatasetError(error.expected, error.got, error.todo) from error
    region = regions.label(anatomy_T_camera.position_mm).astype(np.int64)
    none = np.full(len(stems), FREE)
    files = tuple(pictures[stem] for stem in stems)
    views = Viewpoints(anatomy_T_camera, region, none, none)
    return Dataset(folder, intrinsics, RegionLabels.of(regions), views, files, None, 0.0, None, None, {})


def write_original(dataset: Dataset, folder: Path) -> None:
    """Write a data set as the original's folders, or what is still missing: pictures as they are, poses as text.

    The format keeps neither depth nor rolls nor intrinsics; poses have six decimals.

    Raises:
        DatasetError: if the folder holds other pictures or poses; nothing is touched.
        DiskFull: if there is no room; every file that is there is whole, and the same call goes on.
    """
    check_original(folder, dataset.anatomy_T_camera, dataset.image_files)
    for name in (FRAMES, POSES):
        for leftover in (folder / name).glob(f".*{PART}*"):
            leftover.unlink(missing_ok=True)
    for stem, picture, pose in _named(dataset.anatomy_T_camera, dataset.image_files):
        if not (folder / FRAMES / f"{stem}.png").exists():
            with replacing(folder / FRAMES / f"{stem}.png", durable=False) as part:
                shutil.copyfile(picture, part)
        if not (folder / POSES / f"{stem}.txt").exists():
            write_text(folder / POSES / f"{stem}.txt", original_pose_text(pose), durable=False)


def check_original(folder: Path, anatomy_T_camera: Pose, pictures: Sequence[Path]) -> None:
    """See that `write_original` may write here, also before the pictures of the data set are made.

    Args:
        folder: new, empty, or with (part of) the very files that would be written.
        anatomy_T_camera: (N,) poses of the data set.
        pictures: its N files; those that are not made yet are not there.

    Raises:
        DatasetError: if the folder is a file, or holds a picture or pose that would not be written, or a picture whose
            fellow in the data set is not there to compare it with.
    """
    if folder.exists() and not folder.is_dir():
        raise DatasetError(f"a folder to write to at {folder.name}", "a file", "give another folder")
    there = {path for name in (FRAMES, POSES) for path in _visible(folder / name)}
    for stem, picture, pose in _named(anatomy_T_camera, pictures):
        kept = folder / FRAMES / f"{stem}.png"
        if kept in there and not (picture.is_file() and picture.read_bytes() == kept.read_bytes()):
            raise _others(folder, kept)
        text = folder / POSES / f"{stem}.txt"
        if text in there and text.read_bytes() != original_pose_text(pose).encode():
            raise _others(folder, text)
        there -= {kept, text}
    if there:
        raise _others(folder, min(there))


def _named(anatomy_T_camera: Pose, pictures: Sequence[Path]) -> Iterator[tuple[str, Path, Pose]]:
    """The common name, the picture and the pose of each sample."""
    width = max(2, len(str(len(pictures) - 1)))
    for i, picture in enumerate(pictures):
        yield f"{i:0{width}d}", picture, anatomy_T_camera[i]


def _visible(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if not path.name.startswith(".")] if folder.exists() else []


def _others(folder: Path, path: Path) -> DatasetError:
    return DatasetError(
        f"no {FRAMES}/ and {POSES}/ in {folder.name} but of this very data set",
        f"another {path.relative_to(folder)}",
        "give another folder, or remove these if you no longer need them",
    )


def _by_name(folder: Path, name: str, pattern: str) -> dict[str, Path]:
    if not (folder / name).is_dir():
        raise DatasetError(
            f"a folder {name}/ in {folder.name}", "none", f"give the folder that holds {FRAMES}/ and {POSES}/"
        )
    return {path.stem: path for path in (folder / name).glob(pattern) if not path.name.startswith(".")}


def _refuse_widows(pictures: dict[str, Path], poses: dict[str, Path], folder: Path) -> None:
    for have, lack, what, other in ((pictures, poses, "pose", FRAMES), (poses, pictures, "picture", POSES)):
        alone = sorted(set(have) - set(lack), key=lambda stem: natural_order(have[stem]))
        if alone:
            some = ", ".join(f"{other}/{have[stem].name}" for stem in alone[:5])
            more = f" and {len(alone) - 5} more" if len(alone) > 5 else ""
            raise DatasetError(
                f"a {what} of the same name for each file in {other}/ of {folder.name}",
                f"none for {some}{more}",
                "add what is missing or remove the file",
            )
