"""Whose an output folder is."""

from __future__ import annotations

import json
from pathlib import Path

from naris.core.atomic import write_json
from naris.core.provenance import digest
from naris.errors import ConfigurationChanged

SETTINGS = "settings.json"


def claim(out: Path, settings: dict[str, object]) -> None:
    """Make the folder this experiment's, or see that it is.

    Raises:
        ConfigurationChanged: if it is another's; nothing is touched.
    """
    path = out / SETTINGS
    if path.is_file():
        try:
            known = json.loads(path.read_text(encoding="utf-8")).get("digest")
        except (ValueError, AttributeError):
            known = None
        if known != digest(settings):
            raise ConfigurationChanged(
                f"{out.name} to hold this experiment", "one with other settings", "give another folder with -o"
            )
        return
    write_json(path, {"digest": digest(settings), "settings": settings})
