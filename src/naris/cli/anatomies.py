"""Which anatomy and which of its region sets a command line means."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.anatomy.folder import BUILTIN, DESCRIPTION, SLABS, load_anatomy
from naris.anatomy.read import READERS
from naris.cli.anatomy_from_ct import NOTHING_UNUSUAL, RECORD
from naris.core.anatomy import Anatomy, RegionSet
from naris.errors import InputError, RegionError

if TYPE_CHECKING:
    from naris.register.map import RegistrationMap

MAPS = "maps"
"""The folder of prepared anatomies in the cache."""


def open_anatomy(
    what: str, regions: str | None = None, *, frame: str | None = None, unit: str = "mm"
) -> tuple[Anatomy, RegionSet]:
    """The anatomy that a word means, and the region set to label with.

    Args:
        what: `builtin`, a folder, or a surface file.
        regions: the name of one of its region sets, a JSON file with one, or `slabs`; None for its first.
        frame, unit: of a surface file.

    Raises:
        SurfaceError: if there is no such anatomy, or one that cannot be used.
        RegionError: if there is no such region set.
    """
    added = regions if regions is not None and (regions == SLABS or Path(regions).suffix == ".json") else None
    anatomy = load_anatomy(what, regions=added, frame=frame, unit=unit)
    chosen = anatomy.region_set(None if added else regions)
    if added is not None and (chosen.label(anatomy.before_walls_mm()) < 0).all():
        raise RegionError(
            f"regions of {anatomy.name}", f"some in which it has no air, from {regions}", "give those of this anatomy"
        )
    return anatomy, chosen


def map_of(anatomy: Anatomy) -> RegistrationMap:
    """An anatomy prepared for registration, as an earlier command kept it in the cache folder where one did.

    Raises:
        SurfaceError, EngineUnavailable: as `naris.register.map.registration_map`.
    """
    from naris.fetch import cache_folder
    from naris.register.map import registration_map

    return registration_map(anatomy, cache=cache_folder() / MAPS)


def is_whole_anatomy(what: str) -> bool:
    """Whether a word means an anatomy whose unit and frame are known: `builtin`, or a folder of naris anatomy."""
    path = Path(what)
    return what == BUILTIN or path.name == DESCRIPTION or (path / DESCRIPTION).is_file()


def folder_of(what: str) -> Path:
    """Where that lies which is kept beside an anatomy."""
    path = Path(what)
    return path if path.is_dir() else path.parent


def findings_in(folder: Path) -> str | None:
    """What `naris anatomy from-ct` noticed of the anatomy that it kept in a folder; None where it kept none."""
    record = folder / RECORD
    if not record.is_file():
        return None
    try:
        found = json.loads(record.read_text(encoding="utf-8"))["found"]["findings"]
        return "; ".join(f"{one['weight']}: {one['text']}" for one in found) or NOTHING_UNUSUAL
    except (ValueError, KeyError, TypeError):
        return None


def is_anatomy(what: str) -> bool:
    """Whether a word means an anatomy at all, by its name and without reading it."""
    return is_whole_anatomy(what) or (Path(what).suffix.lower() in READERS and not Path(what).is_dir())


def shaped_nose(what: str, settings: tuple[str, ...]) -> Anatomy:
    """The built-in nose with some of its parameters set, each as `name=number`.

    Raises:
        InputError: if `what` is another anatomy, a parameter is unknown, or a number is none or out of range.
    """
    if what != BUILTIN:
        raise InputError(f"--set with the anatomy {BUILTIN}", repr(what), "leave --set out")
    whole = {field.name for field in fields(NoseParameters)} - set(NORMAL_RANGES)
    values: dict[str, Any] = {}
    for setting in settings:
        name, _, number = setting.partition("=")
        if name not in NORMAL_RANGES and name not in whole:
            known = ", ".join([*NORMAL_RANGES, *sorted(whole)])
            raise InputError(f"--set NAME=NUMBER with one of {known}", repr(setting), "correct the name")
        try:
            values[name] = int(number) if name in whole else float(number)
        except ValueError as error:
            raise InputError(f"a number for {name}", repr(number), f"write --set {name}=…") from error
    return built_in_nose(NoseParameters(**values))
