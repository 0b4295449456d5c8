"""Carry a region set to an anatomy that has none: from other anatomies, by laying each of them on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse

if TYPE_CHECKING:
    from naris.anatomy.transfer import Transfer
    from naris.core.anatomy import Anatomy

PICTURE, RECORD = "anatomy.html", "transfer.json"
SCHEMA = "naris.transfer/1"
UNSURE = 1
_VIRTUAL = 12


@dataclass(frozen=True)
class Options:
    """To which anatomy, from which, and where to."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """A folder made by naris anatomy from-ct, or any other anatomy with its landmarks."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder for the anatomy with its new regions, and a picture: new, empty, or one made by naris anatomy."""
    reference: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ANATOMY", help_behavior_hint="(optional)")] = ()
    """Anatomies to carry from, each with the region set; by default virtual noses with the anatomical one."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME")] = None
    """Which region set of the references; their first when not given. Only with --reference."""
    virtual: IfGiven[int] = None
    """How many virtual noses to carry from, 1 to 100; 12 when not given, about ten seconds each. Not with
    --reference."""


def run(options: Options, console: Console) -> int:
    """Lays the references on the anatomy and keeps it with its regions; exit status 1 where these are not sure.

    A second run of the same anatomy and references finds its own record and does nothing.
    """
    from naris.airway.cut import carry_cut
    from naris.anatomy.builtin.regions import ANATOMICAL
    from naris.anatomy.correspondence import check_laid
    from naris.anatomy.folder import check_folder, check_replaces, region_sets_in, save_anatomy
    from naris.anatomy.transfer import transfer_regions, virtual_references
    from naris.cli.anatomies import findings_in, folder_of, open_anatomy
    from naris.core.atomic import write_json

    if options.reference:
        refuse(options, ("virtual",), "without --reference", _references(len(options.reference)))
    else:
        refuse(options, ("regions",), "only with --reference", "virtual noses, which have anatomical regions")
    check_folder(options.out)
    target, _ = open_anatomy(options.anatomy)
    check_replaces(target.source, options.out)
    check_laid(target)
    references = [open_anatomy(one, options.regions)[0] for one in options.reference]
    count = options.virtual or _VIRTUAL
    name = options.regions or (references[0].region_set().name if references else ANATOMICAL)
    settings = _settings(target, name, [_digest(one, name) for one in references] or count)
    if (earlier := _earlier(settings, options.out)) is not None:
        console.answer(earlier, f"{_text(earlier)}\nit was there already, of these references; nothing was done")
        return 0
    _check_not_its_own(target, settings, folder_of(options.anatomy), options.out)
    if not references:
        with console.progress.task("virtual noses", count) as advance:
            for nose in virtual_references(count):
                references.append(nose)
                advance(1)
    found = transfer_regions(target, references, options.regions, console.progress)
    data = _describe(target, found)
    if not found.usable:
        console.answer(data, f"{_text(data)}\nnot sure enough to be of use; nothing was kept")
        return UNSURE
    others = {name: one for name, one in target.regions.items() if name != found.regions.name}
    made = target.with_(regions={found.regions.name: found.regions, **others})
    # The picture comes last and tells that all is there. Beside an anatomy the record comes first, so that the
    # same command goes on after an interruption that left the new regions; in a new one nothing may come before it.
    (options.out / PICTURE).unlink(missing_ok=True)
    record = {"schema": SCHEMA, "settings": settings, "made": _digest(made, name), "found": data}
    if region_sets_in(options.out):
        write_json(options.out / RECORD, record)
    save_anatomy(made, options.out)
    write_json(options.out / RECORD, record)
    carry_cut(made.source, folder_of(options.anatomy), options.out)
    _write_picture(made, data, options.out, findings_in(folder_of(options.anatomy)))
    data |= _places(options.out, already=False)
    console.answer(data, f"{_text(data)}\nkept in {options.out}, picture in {options.out / PICTURE}")
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"what is in {options.out} is whole, as it was or with its new regions; run the same command again"


def _settings(target: Anatomy, name: str, references: list[str] | int) -> dict[str, Any]:
    """All that decides what is carried: digests of given references, or the number of virtual noses."""
    import naris

    return {"naris": naris.__version__, "anatomy": _digest(target, None), "regions": name, "references": references}


def _digest(anatomy: Anatomy, name: str | None) -> str:
    """Of a surface with its landmarks and one of its region sets, if any."""
    from naris.anatomy.regions import regions_to_json
    from naris.core.provenance import digest

    marks = {key: point.tolist() for key, point in anatomy.landmarks_mm.items()}
    regions = None if name is None else regions_to_json(anatomy.region_set(name))
    return digest({"surface": anatomy.digest, "landmarks_mm": marks, "regions": regions})


def _record(folder: Path) -> dict[str, Any] | None:
    """What an earlier transfer kept beside the anatomy of a folder; None where there is none that can be read."""
    import json

    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return dict(record) if record["schema"] == SCHEMA else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _earlier(settings: dict[str, Any], folder: Path) -> dict[str, Any] | None:
    """What an earlier run of the same settings answered, where all that it kept is still there."""
    from naris.anatomy.folder import load_anatomy
    from naris.errors import NarisError

    record = _record(folder)
    if record is None or record.get("settings") != settings or not (folder / PICTURE).is_file():
        return None
    try:
        is_there = _digest(load_anatomy(folder, passages=False), settings["regions"]) == record["made"]
        return dict(record["found"]) | _places(folder, already=True) if is_there else None
    except (LookupError, TypeError, ValueError, NarisError):
        return None  # changed by hand: it is made anew


def _check_not_its_own(target: Anatomy, settings: dict[str, Any], where: Path, out: Path) -> None:
    """See that regions which are an anatomy's own, as those of a virtual patient, are not written over.

    Raises:
        ConfigurationChanged: if they would be.
    """
    from naris.errors import ConfigurationChanged

    name = settings["regions"]
    if name not in target.regions or out.resolve() != where.resolve():
        return
    earlier = (_record(out) or {}).get("settings", {})
    if (earlier.get("regions"), earlier.get("anatomy")) != (name, settings["anatomy"]):
        raise ConfigurationChanged(
            f"an anatomy without regions {name} in {out}",
            f"{target.name}, which has its own",
            "keep those, or give another folder",
        )


def _places(folder: Path, *, already: bool) -> dict[str, Any]:
    return {"folder": folder, "picture": folder / PICTURE, "already": already}


def _describe(target: Anatomy, found: Transfer) -> dict[str, Any]:
    import numpy as np

    from naris.core.anatomy import NOWHERE

    labels = np.where(found.lumen, found.regions.labels, NOWHERE)
    ml = found.regions.spacing_mm**3 / 1000
    return {
        "anatomy": target.name,
        "usable": found.usable,
        "region_set": found.regions.name,
        "instead_of_its_own": found.regions.name in target.regions,
        "likely": round(found.likely, 3),
        "regions": {
            name: {
                "volume_ml": round(float((labels == k).sum()) * ml, 2),
                "sure": round(float(found.sure[labels == k].mean()), 3) if (labels == k).any() else None,
            }
            for k, name in enumerate(found.regions.names)
        },
        "references": [
            {"name": fit.name, "off_mm": round(fit.mean_mm, 2), "off_p95_mm": round(fit.p95_mm, 2),
             "weight": round(fit.weight, 3)}
            for fit in found.fits
        ],
    }  # fmt: skip


def _text(data: dict[str, Any]) -> str:
    best = min(data["references"], key=lambda one: one["off_mm"])
    lines = [
        f"{data['anatomy']}: regions {data['region_set']}, "
        f"expected to be right for {100 * data['likely']:.0f} % of the lumen",
        f"  {_references(len(data['references']))}; "
        f"{best['name']} lies nearest, {best['off_mm']:.2f} mm off on average",
    ]
    if data["instead_of_its_own"]:
        lines.append(f"  instead of regions {data['region_set']} that the anatomy had")
    for name, one in data["regions"].items():
        sure = "not there" if one["sure"] is None else f"{one['volume_ml']:5.1f} ml, {100 * one['sure']:.0f} % sure"
        lines.append(f"  {name:<44}{sure}")
    return "\n".join(lines)


def _references(count: int) -> str:
    return "1 reference" if count == 1 else f"{count} references"


def _write_picture(made: Anatomy, data: dict[str, Any], folder: Path, known: str | None) -> None:
    from naris.airway.cut import read_cut
    from naris.core.atomic import write_text
    from naris.report.anatomy_page import anatomy_page

    count = len(data["references"])
    noses = "another nose" if count == 1 else f"{count} other noses"
    facts = {
        "from": made.source,
        "regions": f"{data['region_set']}, carried from {noses}, expected to be right for"
        f" {100 * data['likely']:.0f} % of the lumen",
    } | ({} if known is None else {"to know": known})
    write_text(folder / PICTURE, anatomy_page(made, data["region_set"], facts, read_cut(folder, made.source)))
