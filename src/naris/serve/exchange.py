"""Keyframes that are taken in from files and given away as files: ours, and those of the original."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from naris.core.anatomy import Anatomy
from naris.core.pose import Pose
from naris.render.keyframes import (
    Keyframe,
    Keyframes,
    read_keyframes,
    read_original_pose,
    write_keyframes,
    write_original_keyframes,
)
from naris.serve.archive import texts_in

_TEXT, _MOST_LETTERS = ".txt", 80


def taken(content: bytes, name: str, anatomy: Anatomy) -> Keyframes:
    """The keyframes of a file.

    Of ours; or, called `NAME.txt`, one of the original; or of a ZIP archive of such, in the order of their names.

    Raises:
        KeyframeError: if it is none, or of another anatomy.
    """
    with TemporaryDirectory() as folder:
        if name.lower().endswith(".zip"):
            texts = texts_in(content, _TEXT)
            return Keyframes(tuple(_original(text, entry, anatomy.frame, Path(folder)) for entry, text in texts))
        if name.lower().endswith(_TEXT):
            return Keyframes((_original(content, name, anatomy.frame, Path(folder)),))
        path = Path(folder) / "the file"
        path.write_bytes(content)
        return read_keyframes(path, anatomy)


def as_json(keyframes: Keyframes) -> bytes:
    """Our file of them."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "keyframes.json"
        write_keyframes(keyframes, path)
        return path.read_bytes()


def as_original(keyframes: Keyframes, seen_from: Callable[[Pose], UInt8[np.ndarray, "h w 3"]]) -> bytes:
    """A ZIP archive of a text file of the original for each, and beside it the picture from there, as PNG.

    Where names cannot name files, or repeat, the files are numbered.
    """
    buffer = io.BytesIO()
    with TemporaryDirectory() as folder, zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as whole:
        paths = write_original_keyframes(_with_file_names(keyframes), Path(folder))
        for path, one in zip(paths, keyframes.keyframes, strict=True):
            whole.write(path, path.name)
            picture = io.BytesIO()
            Image.fromarray(seen_from(one.anatomy_T_camera)).save(picture, "PNG")
            whole.writestr(f"{path.stem}.png", picture.getvalue(), zipfile.ZIP_STORED)
    return buffer.getvalue()


def _original(text: bytes, name: str, frame: str, folder: Path) -> Keyframe:
    path = folder / re.sub(r"[^\w.-]", "_", name[-_MOST_LETTERS:])  # errors name it
    path.write_bytes(text)
    return Keyframe(name[: -len(_TEXT)][:_MOST_LETTERS], read_original_pose(path, frame))


def _with_file_names(keyframes: Keyframes) -> Keyframes:
    names = [one.name for one in keyframes.keyframes]
    if len(set(names)) == len(names) and all(re.fullmatch(r"[\w.-]+", name) for name in names):
        return keyframes
    return Keyframes.of(keyframes.anatomy_T_camera)
