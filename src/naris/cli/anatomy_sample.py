"""Make virtual patients: noses whose parameters are drawn from the normal ranges, each an anatomy like any other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console

if TYPE_CHECKING:
    from naris.core.anatomy import Anatomy

PATIENTS = "patients.json"
SCHEMA = "naris.patients/1"


@dataclass(frozen=True)
class Options:
    """How many, and where to."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder for the patients, each in a folder of its own: new, empty, or one made by this command with that seed."""
    count: int = 10
    """How many there shall be; those that are there already are kept."""
    seed: int = 0
    """Of the population. A patient depends on it and on its number alone."""


def run(options: Options, console: Console) -> int:
    """Makes the patients that are not there yet."""
    from naris.anatomy.builtin.variation import virtual_patient
    from naris.anatomy.folder import DESCRIPTION, save_anatomy

    _claim(options)
    made: list[dict[str, Any]] = []
    with console.progress.task("virtual patients", options.count) as advance:
        for number in range(options.count):
            folder = options.out / f"{number:04d}"
            if not (folder / DESCRIPTION).is_file():
                nose = virtual_patient(options.seed, number)
                save_anatomy(nose, folder)
                made.append({"folder": folder, **_told(nose)})
            advance(1)
    data = {"seed": options.seed, "count": options.count, "made": made, "folder": options.out}
    kept = options.count - len(made)
    already = f", {kept} were there already" if kept else ""
    console.answer(data, f"{len(made)} virtual patients made in {options.out}{already}")
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"the patients made so far are in {options.out}; the same command goes on from there"


def _claim(options: Options) -> None:
    """See that the folder is this population's, or make it so."""
    import json

    from naris.core.atomic import write_json
    from naris.errors import ConfigurationChanged, InputError

    out, path = options.out, options.out / PATIENTS
    if out.exists() and not out.is_dir():
        raise InputError(f"a folder at {out}", "a file", "give another path")
    if path.is_file():
        try:
            seed = json.loads(path.read_text(encoding="utf-8"))["seed"]
        except (ValueError, LookupError, TypeError):
            seed = None
        if seed != options.seed:
            raise ConfigurationChanged(
                f"virtual patients of seed {options.seed} in {out}", f"seed {seed}", "give another folder or seed"
            )
        return
    if out.exists() and any(not one.name.startswith(".") for one in out.iterdir()):
        raise InputError(f"a new or empty folder, or one with {PATIENTS}", f"other files in {out}", "give another path")
    write_json(path, {"schema": SCHEMA, "seed": options.seed})


def _told(nose: Anatomy) -> dict[str, Any]:
    return {"name": nose.name, "digest": nose.digest, "source": nose.source}
