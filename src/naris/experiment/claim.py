"""Whose an output folder is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from naris.core.atomic import write_json
from naris.core.differences import differences
from naris.core.provenance import digest
from naris.errors import ConfigurationChanged, InputError

SETTINGS = "settings.json"
_TYPED = {
    "chain": {"fit_steps": "--fit-steps", "seed": "--seed"},
    "demo": {"budget_s": "--budget-s", "seed": "--seed"},
    "reproduce": {
        "epochs": "--epochs",
        "runs": "--runs",
        "compact_runs": "--runs",
        "compact_epochs": "--compact-epochs",
        "at_will_steps": "--at-will-steps",
        "seed": "--seed",
        "look.material": "--texture",
    },
}
"""The settings of each experiment that somebody types, as they are typed."""
_DATA = {"anatomy": "the anatomy"}
"""Settings that say on what."""


def claim(out: Path, settings: dict[str, object]) -> bool:
    """Make the folder this experiment's, or see that it is; True if it was not before.

    Raises:
        InputError: if it is a file, or holds something else than an experiment; nothing is touched.
        ConfigurationChanged: if it is another experiment's; it names what differs, and nothing is touched.
    """
    path = out / SETTINGS
    if out.exists() and not out.is_dir():
        raise InputError(f"a folder at {out}", "a file", "give another folder with -o")
    if path.is_file():
        known = _record(path)
        if known.get("digest") != digest(settings):
            got = _changed(known.get("settings"), settings)
            raise ConfigurationChanged(f"{out.name} to hold this experiment", got, "give another folder with -o")
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


def _record(path: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _changed(old: object, new: Mapping[str, object]) -> str:
    """What is there instead of this experiment."""
    if not isinstance(old, Mapping):
        return "one with other settings"
    before, after = _row(old), _row(new)
    kind = after.get("experiment")
    if kind is not None and before.get("experiment") != kind:
        return f"another, {before.get('experiment')}"
    told = {
        "settings": differences(_part(before, of_data=False), _part(after, of_data=False), _TYPED.get(str(kind), {})),
        "data": differences(_part(before, of_data=True), _part(after, of_data=True), _DATA),
    }
    return " and ".join(f"other {name}: {what}" for name, what in told.items() if what) or "one with other settings"


def _row(settings: Mapping[str, Any]) -> dict[str, Any]:
    """All settings beside each other, those of the configuration among them."""
    config = settings.get("config")
    return {**settings, "config": None, **(config if isinstance(config, Mapping) else {})}


def _part(settings: Mapping[str, Any], *, of_data: bool) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if (name in _DATA) == of_data}
