"""What is kept of a registration: the pose for 3D Slicer, landmarks, and what its camera sees."""

from __future__ import annotations

from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from naris.cli.observed import Seen
    from naris.cli.register import Options
    from naris.core.anatomy import Anatomy
    from naris.core.pose import Pose

RESULT, LANDMARKS = "registration.json", "landmarks.mrk.json"
TRANSFORM, HDF5 = "anatomy_T_camera.tfm", "anatomy_T_camera.h5"
VIEW, OVERLAY, FLICKER, REFUSED = "view.png", "overlay.png", "flicker.gif", "refused.png"
SHAPE, LOOSENESS = "anatomy", "vertex_sd_mm.npy"
_TOLD_ELSEWHERE = ("anatomy", "out", "seed")
OWN = (RESULT, LANDMARKS, TRANSFORM, HDF5, VIEW, OVERLAY, FLICKER, REFUSED, SHAPE, LOOSENESS)


def made_from(options: Options) -> dict[str, Any]:
    """The version, and what was given: of files, folders and a view's name the SHA-256, for names may tell patients."""
    import naris

    told: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if field.name in _TOLD_ELSEWHERE or (field.default is not MISSING and value == field.default):
            continue
        told[field.name] = _digest(value) if isinstance(value, Path) or field.name == "view" else value
    return {"naris": naris.__version__, "seed": options.seed, "options": told}


def _digest(of: Path | str) -> dict[str, str]:
    """Of a folder over the sorted digests of its files, whatever they are called."""
    import hashlib

    from naris.core.provenance import file_digest

    if isinstance(of, str):
        return {"sha256": hashlib.sha256(of.encode()).hexdigest()}
    if of.is_file():
        return {"sha256": file_digest(of)}
    each = sorted(file_digest(one) for one in of.rglob("*") if one.is_file())
    return {"sha256_of_files": hashlib.sha256("\n".join(each).encode()).hexdigest()}


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
    folder: Path, pose: Pose | None, anatomy: Anatomy, looks: dict[str, bytes], data: dict[str, Any]
) -> list[str]:
    """Writes them and tells the files. A refused pose gets no transform: nothing that looks like an answer."""
    from naris.anatomy.folder import remove_anatomy
    from naris.core.atomic import write_bytes, write_json, write_text
    from naris.register.files import slicer_landmarks, slicer_transform, write_slicer_hdf5

    folder.mkdir(parents=True, exist_ok=True)
    for name in (TRANSFORM, HDF5, VIEW, OVERLAY, FLICKER, REFUSED, LOOSENESS):
        (folder / name).unlink(missing_ok=True)
    remove_anatomy(folder / SHAPE)
    written = [folder / RESULT, folder / LANDMARKS]
    write_json(folder / RESULT, data)
    write_json(folder / LANDMARKS, slicer_landmarks(anatomy, pose))
    if pose is not None and anatomy.frame == "LPS":
        write_text(folder / TRANSFORM, slicer_transform(pose))
        write_slicer_hdf5(pose, folder / HDF5)
        written += [folder / TRANSFORM, folder / HDF5]
    for name, content in looks.items():
        write_bytes(folder / name, content)
        written.append(folder / name)
    return [str(file) for file in written]
