"""What is kept of a registration: the pose for 3D Slicer, landmarks, and what its camera sees."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
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
        SurfaceError: if it holds a shape whose description cannot be read.
    """
    from naris.anatomy.folder import BUILTIN

    check_own(folder, OWN, "a registration")
    others = sorted(one.name for one in folder.iterdir() if one.name in OWN) if folder.is_dir() else []
    record = _record(folder / RESULT)
    if others and record is None:
        got = f"{', '.join(others)} of another origin in {folder}"
        raise InputError("a new or empty folder, or one with a registration", got, "give another path")
    for name in others:
        if (folder / name).is_dir() != (name == SHAPE):
            got = f"a {'file' if name == SHAPE else 'folder'}"
            raise InputError(f"{folder / name} as a registration leaves it", got, "give another path to -o")
    if record is not None and SHAPE in others:
        _check_shape(folder / SHAPE, record)
    where = None if anatomy == BUILTIN else Path(anatomy)
    if where is not None and where.exists() and where.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"an ANATOMY outside of {folder}", "one that would be overwritten", "give another path to -o")


def _check_shape(folder: Path, record: dict[str, Any]) -> None:
    """See that a folder holds nothing but the shape that a registration left there."""
    from naris.anatomy.folder import digest_in, others_in

    others, known = others_in(folder), [one.get("digest") for one in _shapes(record)]
    if digest_in(folder) not in (None, *known):
        others.append("an anatomy of another origin")
    if others:
        expected = f"nothing but the shape of the earlier registration in {folder}"
        raise InputError(expected, ", ".join(others[:3]), "give another path to -o")


def _shapes(record: dict[str, Any]) -> list[dict[str, Any]]:
    """What a record tells of the shape that is beside it; one that is unfinished of all that may be."""
    told = record.get("deformed")
    return [one for one in (told if isinstance(told, list) else [told]) if isinstance(one, dict)]


def _record(file: Path) -> dict[str, Any] | None:
    """What a file tells, if it is the record of a registration, or of one that was broken off."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) and content.get("schema") in SCHEMAS else None


def made_from(options: Options) -> dict[str, Any]:
    """The version, and what was given: of files and folders the SHA-256, for their names may tell patients.

    Of an anatomy that could be opened.
    """
    from naris.anatomy.folder import BUILTIN, DESCRIPTION, files_in

    told: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if field.name in _TOLD_ELSEWHERE or (field.default is not MISSING and value == field.default):
            continue
        told[field.name] = _digest(value) if isinstance(value, Path) else value
    if options.regions is not None and Path(options.regions).suffix == ".json":
        told["regions"] = _digest(Path(options.regions))
    where = Path(options.anatomy)
    if options.anatomy == BUILTIN:
        told["anatomy"] = BUILTIN
    elif where.is_dir() or where.name == DESCRIPTION:
        where = where if where.is_dir() else where.parent
        told["anatomy"] = _digest_of(files_in(where), where)
    else:
        told["anatomy"] = _digest(where)
    if options.view is not None:
        told["view"] = True  # so may the name of a picture, and a digest of so few words is read like them
    if options.rig is not None:
        from naris.register.rig import depths_of

        told["rig"]["depths"] = [_digest(file) for file in depths_of(options.rig)]
    return {"naris": naris.__version__, "seed": options.seed, "options": told}


def _digest(path: Path) -> dict[str, str]:
    if path.is_file():
        return {"sha256": file_digest(path)}
    return _digest_of([one for one in path.rglob("*") if one.is_file()], path)


def _digest_of(files: list[Path], folder: Path) -> dict[str, str]:
    """What `sha256sum` of what it prints of the files prints, in the order of their names from a folder on."""
    names = {os.fsencode(one.relative_to(folder).as_posix()): one for one in files}
    lines = b"".join(file_digest(names[name]).encode() + b"  " + name + b"\n" for name in sorted(names))
    return {"sha256_of_files": hashlib.sha256(lines).hexdigest()}


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

    All is written whole into a hidden folder first, so an earlier registration is there until nothing can fail any
    more. Then `RESULT` says that it is unfinished, the others change places, and `RESULT` comes last: what it tells,
    and all beside it, are of one registration.

    Args:
        folder: new, empty or with an earlier registration (`check_folder`).
        pose: of the camera, None where it was refused.
        anatomy: that it is in.
        looks: other files by name.
        data: of `RESULT`.
        deformed: whether the anatomy is to be kept as well, for its shape was estimated.

    Raises:
        DiskFull: if there is no room; an earlier registration is still there.
    """
    from naris.anatomy.folder import remove_anatomy
    from naris.core.atomic import PART, disk_full_told, write_json

    folder.mkdir(parents=True, exist_ok=True)
    for left_by_a_kill in folder.glob(f"{PART}-*"):
        shutil.rmtree(left_by_a_kill, ignore_errors=True)
    with disk_full_told(folder):
        new = Path(tempfile.mkdtemp(prefix=f"{PART}-", dir=folder))
    try:
        names = _write_all(new, pose, anatomy, looks, data, deformed=deformed)
        shapes = _shapes(_record(folder / RESULT) or {}) + _shapes(data)
        write_json(folder / RESULT, {"schema": data["schema"], "status": UNFINISHED, "deformed": shapes})
        for name in set(OWN) - {RESULT, SHAPE}:
            (folder / name).unlink(missing_ok=True)
        if (folder / SHAPE).is_dir():
            remove_anatomy(folder / SHAPE)
        for name in [*names[1:], names[0]]:
            _move(new / name, folder / name)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return [str(folder / name) for name in names]


def _move(what: Path, where: Path) -> None:
    """A file to where none is any more, or a folder, of which what is hidden may still be there."""
    if where.is_dir():
        for one in what.iterdir():
            one.replace(where / one.name)
    else:
        what.replace(where)


def _write_all(
    folder: Path, pose: Pose | None, anatomy: Anatomy, looks: dict[str, bytes], data: dict[str, Any], *, deformed: bool
) -> list[str]:
    """Writes all files of a registration into an empty folder, and tells their names, `RESULT` first."""
    from naris.anatomy.folder import save_anatomy
    from naris.core.atomic import write_bytes, write_json, write_text
    from naris.register.files import slicer_landmarks, slicer_transform, write_slicer_hdf5

    write_json(folder / RESULT, data)
    names = [RESULT]
    if anatomy.frame == "LPS":
        write_json(folder / LANDMARKS, slicer_landmarks(anatomy, pose))
        names.append(LANDMARKS)
        if pose is not None:
            write_text(folder / TRANSFORM, slicer_transform(pose))
            write_slicer_hdf5(pose, folder / HDF5)
            names += [TRANSFORM, HDF5]
    for name, content in looks.items():
        write_bytes(folder / name, content)
        names.append(name)
    if deformed:
        save_anatomy(anatomy, folder / SHAPE)
        names.append(SHAPE)
    return names
