"""What is kept of a registration: the pose for 3D Slicer, landmarks, and what its camera sees."""

from __future__ import annotations

import hashlib
import json
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import naris
from naris.cli.folders import check_own
from naris.core.provenance import file_digest
from naris.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from naris.cli.observed import Seen
    from naris.cli.register import Options
    from naris.core.anatomy import Anatomy
    from naris.core.pose import Pose

RESULT, LANDMARKS = "registration.json", "landmarks.mrk.json"
TRANSFORM, HDF5 = "anatomy_T_camera.tfm", "anatomy_T_camera.h5"
VIEW, OVERLAY, FLICKER, REFUSED = "view.png", "overlay.png", "flicker.gif", "refused.png"
SHAPE, LOOSENESS = "deformed", "vertex_sd_mm.npy"
SCHEMAS = ("naris.registration/1", "naris.deformable-registration/1")
"""Of rigid registrations, and of those that estimate a shape."""
UNFINISHED = "unfinished"
_TOLD_ELSEWHERE = ("anatomy", "out", "seed")
OWN = (RESULT, LANDMARKS, TRANSFORM, HDF5, VIEW, OVERLAY, FLICKER, REFUSED, SHAPE, LOOSENESS)


def check_folder(folder: Path, anatomy: str) -> None:
    """See that what is kept there can be written without a loss.

    Args:
        folder: of `-o`.
        anatomy: as it was named.

    Raises:
        InputError: if it holds anything else than an earlier registration, or the anatomy itself.
    """
    check_own(folder, OWN, "a registration")
    others = sorted(one.name for one in folder.iterdir() if one.name in OWN) if folder.is_dir() else []
    if others and not _is_registration(folder / RESULT):
        got = f"{', '.join(others)} of another origin in {folder}"
        raise InputError("a new or empty folder, or one with a registration", got, "give another path")
    if Path(anatomy).exists() and Path(anatomy).resolve().is_relative_to(folder.resolve()):
        raise InputError(f"an ANATOMY outside of {folder}", "one that would be overwritten", "give another path to -o")


def _is_registration(file: Path) -> bool:
    """Whether a file is the record of a registration, or of one that was broken off."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("schema") in SCHEMAS


def made_from(options: Options) -> dict[str, Any]:
    """The version, and what was given: of files and folders the SHA-256, for their names may tell patients."""
    told: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if field.name in _TOLD_ELSEWHERE or (field.default is not MISSING and value == field.default):
            continue
        told[field.name] = _digest(value) if isinstance(value, Path) else value
    where = Path(options.anatomy)
    told["anatomy"] = _digest(where) if where.exists() else options.anatomy
    if options.view is not None:
        told["view"] = True  # so may the name of a picture, and a digest of so few words is read like them
    if options.rig is not None:
        from naris.register.rig import depths_of

        told["rig"]["depths"] = [_digest(file) for file in depths_of(options.rig)]
    return {"naris": naris.__version__, "seed": options.seed, "options": told}


def _digest(path: Path) -> dict[str, str]:
    """Of a folder over its files, each with its digest and name."""
    if path.is_file():
        return {"sha256": file_digest(path)}
    files = sorted(one for one in path.rglob("*") if one.is_file())
    lines = "".join(f"{file_digest(one)}  {one.relative_to(path).as_posix()}\n" for one in files)
    return {"sha256_of_files": hashlib.sha256(lines.encode()).hexdigest()}


def looks_of(
    pose: Pose | None, anatomy: Anatomy, seen: Seen, ground: np.ndarray | None, *, flickers: bool
) -> dict[str, bytes]:
    """What the registered camera sees, and its walls drawn on what the real one saw; none for a refused pose.

    Of a real picture also both in turn: an eye that sees them blink finds an error that no line shows.
    """
    from naris.register.look import blinking, overlay, png, seen_from
    from naris.render.scene import Scene

    if pose is None or ground is None or seen.intrinsics is None:
        return {}
    rgb, depth = seen_from(Scene(anatomy), pose, seen.intrinsics)
    looks = {VIEW: png(rgb), OVERLAY: png(overlay(ground, depth))}
    return looks | {FLICKER: blinking(ground, rgb)} if flickers else looks


def look_of_refused(best: Pose, anatomy: Anatomy, seen: Seen, ground: np.ndarray | None) -> dict[str, bytes]:
    """What the best guess looks like, marked as what it is: who asks why it was refused wants to see it."""
    from naris.register.look import png, refused, seen_from
    from naris.render.scene import Scene

    if ground is None or seen.intrinsics is None:
        return {}
    return {REFUSED: png(refused(ground, *seen_from(Scene(anatomy), best, seen.intrinsics)))}


def write_registered(
    folder: Path,
    pose: Pose | None,
    anatomy: Anatomy,
    looks: dict[str, bytes],
    data: dict[str, Any],
    *,
    deformed: bool = False,
) -> list[str]:
    """Writes them and tells the files. A refused pose gets no transform: nothing that looks like an answer.

    First `RESULT` says that it is unfinished, then what an earlier registration left is taken away, and last `RESULT`
    is written whole: what it tells, and all beside it, are of one registration.

    Args:
        folder: new, empty or with an earlier registration (`check_folder`).
        pose: of the camera, None where it was refused.
        anatomy: that it is in.
        looks: other files by name.
        data: of `RESULT`.
        deformed: whether the anatomy is to be kept as well, for its shape was estimated.
    """
    from naris.anatomy.folder import remove_anatomy, save_anatomy
    from naris.core.atomic import write_bytes, write_json, write_text
    from naris.register.files import slicer_landmarks, slicer_transform, write_slicer_hdf5

    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RESULT, {"schema": data["schema"], "status": UNFINISHED})
    for name in (LANDMARKS, TRANSFORM, HDF5, VIEW, OVERLAY, FLICKER, REFUSED, LOOSENESS):
        (folder / name).unlink(missing_ok=True)
    remove_anatomy(folder / SHAPE)
    written = [folder / RESULT]
    if anatomy.frame == "LPS":
        write_json(folder / LANDMARKS, slicer_landmarks(anatomy, pose))
        written.append(folder / LANDMARKS)
        if pose is not None:
            write_text(folder / TRANSFORM, slicer_transform(pose))
            write_slicer_hdf5(pose, folder / HDF5)
            written += [folder / TRANSFORM, folder / HDF5]
    for name, content in looks.items():
        write_bytes(folder / name, content)
        written.append(folder / name)
    if deformed:
        save_anatomy(anatomy, folder / SHAPE)
        written.append(folder / SHAPE)
    write_json(folder / RESULT, data)
    return [str(file) for file in written]
