"""Whose an output folder is."""

from __future__ import annotations

import json
from pathlib import Path

from naris.core.atomic import write_json
from naris.core.provenance import digest
from naris.errors import ConfigurationChanged, InputError

SETTINGS = "settings.json"


def claim(out: Path, settings: dict[str, object]) -> bool:
    """Make the folder this experiment's, or see that it is; True if it was not before.

    Raises:
        InputError: if it is a file, or holds something else than an experiment; nothing is touched.
        ConfigurationChanged: if it is another experiment's; nothing is touched.
    """
    path = out / SETTINGS
    if out.exists() and not out.is_dir():
        raise InputError(f"a folder at {out}", "a file", "give another folder with -o")
    if path.is_file():
        try:
            known = json.loads(path.read_text(encoding="utf-8")).get("digest")
        except (ValueError, AttributeError):
            known = None
        if known != digest(settings):
            raise ConfigurationChanged(
                f"{out.name} to hold this experiment", "one with other settings", "give another folder with -o"
            )
        return False
    # Hidden files do not count: a folder that looks empty is empty to whoever gives it.
    if out.exists() and any(not path.name.startswith(".") for path in out.iterdir()):
        raise InputError(
            f"a new or empty folder, or one with {SETTINGS} of this experiment",
            f"other files in {out}",
            "give another folder with -o",
        )
    write_json(path, {"digest": digest(settings), "settings": settings})
    return True
