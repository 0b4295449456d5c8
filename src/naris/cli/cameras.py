"""Which camera a command line means."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from naris.core.camera import Intrinsics
from naris.dataset.layout import intrinsics_from_json
from naris.errors import InputError

_log = logging.getLogger(__name__)
_FAR_OFF = 0.2


def read_intrinsics(path: Path) -> Intrinsics:
    """The camera in a JSON file of its own, or that of a data set (its `dataset.json`).

    Raises:
        InputError: if there is none.
    """
    todo = (
        'give a JSON file such as {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 319.5, "cy": 239.5, '
        '"lens": {"kind": "pinhole"}}, or the dataset.json of a data set'
    )
    if not path.exists() or path.is_dir():
        got, check = ("a folder", "give a file in it") if path.is_dir() else ("no such file", "check the path")
        raise InputError(f"intrinsics at {path}", got, check)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"intrinsics in JSON in {path.name}", "something else", todo) from error
    inner = content.get("intrinsics", content) if isinstance(content, dict) else content
    try:
        intrinsics = intrinsics_from_json(inner)
    except InputError as error:
        raise InputError(f"{error.expected} in {path.name}", error.got, todo) from error
    warn_of_centre(intrinsics, path)
    return intrinsics


def warn_of_centre(intrinsics: Intrinsics, path: Path) -> None:
    """Tell a principal point that lies far from the middle of the picture; `path` is where it was read from."""
    off = max(abs((intrinsics.cx + 0.5) / intrinsics.width - 0.5), abs((intrinsics.cy + 0.5) / intrinsics.height - 0.5))
    if off > _FAR_OFF:
        _log.warning(
            "%s puts the principal point %.0f %% of the picture from its middle: check cx and cy, for a wrong one "
            "turns the pose",
            path.name,
            100 * off,
        )
