"""Find the airway of the nose in a CT and keep it as an anatomy, with its segmentation for 3D Slicer and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, check_name

if TYPE_CHECKING:
    from naris.airway.segment import Airway
    from naris.anatomy.scanned import ScannedAnatomy
    from naris.ct.scan import Finding, Scan

SEGMENTATION, PICTURE, RECORD = "segmentation.seg.nrrd", "anatomy.html", "from_ct.json"
SCHEMA = "naris.from-ct/1"
NOTHING_UNUSUAL = "nothing unusual was noticed"
NO_AIRWAY = 1


@dataclass(frozen=True)
class Options:
    """Which scan, and where to."""

    scan: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCAN")]
    """A DICOM folder or file, or a .nrrd, .nii, .nii.gz, .mha or .mhd file, in Hounsfield units."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder for the anatomy: new, empty, or one with an anatomy of the same scan, which is replaced where it was made
    under other settings."""
    series: Annotated[IfGiven[str], tyro.conf.arg(metavar="KEY")] = None
    """Which DICOM series, where a folder holds several (the message that says so lists them)."""
    name: str = "patient"
    """What to call the anatomy; it goes into every output, so no name of a person."""
    step_mm: float = 0.5
    """Of the lattice that the scan is looked at on: 0.2 to 1.0."""
    sinuses: bool = False
    """Keep the sinuses and what else opens into the nose, instead of the nasal cavities and the nasopharynx alone."""


def run(options: Options, console: Console) -> int:
    """Reads, segments, makes the surface and keeps all of it; exit status 1 where there is no usable airway."""
    from naris.airway.fitness import look_at
    from naris.airway.turned import airway_in
    from naris.anatomy.folder import check_folder, source_in
    from naris.anatomy.scanned import anatomy_of_airway
    from naris.ct.read import read_scan
    from naris.errors import PoseError, ScanError, SurfaceError

    if not 0.2 <= options.step_mm <= 1.0:
        from naris.errors import InputError

        raise InputError("--step-mm between 0.2 and 1.0", f"{options.step_mm:g}", "use 0.5")
    check_name(options.name)
    check_folder(options.out)
    scan = read_scan(options.scan, options.series, console.progress)
    settings = _settings(scan, options)
    if (earlier := _earlier(settings, options.out)) is not None:
        console.answer(earlier, f"{_text(earlier)}\nit was there already, of these settings; nothing was done")
        return 0
    _check_same(scan, options.out)
    replaced = source_in(options.out)
    with console.progress.task("anatomy", 3) as advance:
        try:
            airway = airway_in(scan.volume, [options.step_mm])
            advance(1)
            made = anatomy_of_airway(airway, options.name, _source(scan, options), attached=options.sinuses)
            advance(1)
        except (ScanError, SurfaceError) as error:
            return _no_airway(str(error), scan, look_at(scan).findings, options.out, console)
        except PoseError:
            reason = (
                "expected a way for a camera from both nostrils to the nasopharynx, got none; the nose is too narrow"
            )
            return _no_airway(reason, scan, look_at(scan, airway).findings, options.out, console)
        findings = tuple(dict.fromkeys((*look_at(scan, airway).findings, *made.findings)))
        found = _describe(made, airway, findings)
        _keep(made, airway, {"schema": SCHEMA, "settings": settings, "found": found}, options.out)
        advance(1)
    data = found | _places(options.out, already=False, replaced=replaced)
    told = [] if replaced is None else [f"instead of an earlier one of the same scan: {replaced}"]
    console.answer(data, "\n".join([_text(data), *told]))
    return 0


def _keep(made: ScannedAnatomy, airway: Airway, record: dict[str, Any], folder: Path) -> None:
    """Writes all of it; the record comes last, as a folder without one is made anew."""
    from naris.airway.cut import write_cut
    from naris.airway.segments import write_segments
    from naris.anatomy.folder import save_anatomy
    from naris.core.atomic import write_json

    for name in (SEGMENTATION, PICTURE, RECORD):
        (folder / name).unlink(missing_ok=True)  # no anatomy shall stand beside those of another
    save_anatomy(made.anatomy, folder)
    write_segments(airway, folder / SEGMENTATION)
    write_cut(airway.block, made.anatomy.bounds_mm, made.anatomy.source, folder)
    _write_picture(made, airway, record["found"], folder)
    write_json(folder / RECORD, record)


def _check_same(scan: Scan, out: Path) -> None:
    """See that an anatomy in the folder is of this scan: that of another is not to be lost."""
    from naris.anatomy.folder import region_sets_in, source_in
    from naris.anatomy.regions import PAPER
    from naris.errors import ConfigurationChanged

    earlier = source_in(out)
    if earlier is not None and _values(scan) not in earlier:
        expected = f"no anatomy in {out}, or one of this scan ({_values(scan)})"
        raise ConfigurationChanged(expected, f"one from {earlier or 'elsewhere'}", "give another folder")
    if carried := [name for name in region_sets_in(out) if name != PAPER]:
        raise ConfigurationChanged(
            f"an anatomy without carried regions in {out}", f"one with {', '.join(carried)}", "give another folder"
        )


def _no_airway(reason: str, scan: Scan, findings: tuple[Finding, ...], out: Path, console: Console) -> int:
    """The honest answer; what an earlier run kept in the folder is not of this scan."""
    from naris.anatomy.folder import DESCRIPTION
    from naris.cli.anatomy_inspect import scan_data, scan_text

    earlier = (out / DESCRIPTION).is_file()
    kept = f"nothing was kept, and {out} still holds the anatomy of an earlier run" if earlier else "nothing was kept"
    read = scan_data(scan)
    data = read | {"usable": False, "reason": reason, "findings": [one.to_json() for one in findings]}
    told = [f"no usable airway: {reason}", f"  {scan_text(read)}"]
    told += [*(f"  {one.weight}: {one.text}" for one in findings), kept]
    console.answer(data | {"earlier": earlier}, "\n".join(told))
    return NO_AIRWAY


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "what is in the folder is whole or missing; run the same command again"


def _source(scan: Scan, options: Options) -> str:
    spacing = "×".join(f"{edge:.3g}" for edge in scan.volume.spacing_mm)
    sinuses = " with what opens into the nose" if options.sinuses else ""
    return f"{scan.format} CT of {spacing} mm, {_values(scan)}, segmented at {options.step_mm:g} mm{sinuses}"


def _settings(scan: Scan, options: Options) -> dict[str, Any]:
    """All that decides what is found: where these are the same, so is the anatomy."""
    import naris

    return {
        "naris": naris.__version__,
        "scan": _values(scan),
        "frame_T_index": scan.volume.frame_T_index.tolist(),
        "name": options.name,
        "step_mm": options.step_mm,
        "sinuses": options.sinuses,
    }


def _earlier(settings: dict[str, Any], folder: Path) -> dict[str, Any] | None:
    """What an earlier run under the same settings answered, where all that it kept is still there."""
    import json

    from naris.anatomy.folder import load_anatomy
    from naris.errors import NarisError

    if not all((folder / name).is_file() for name in (RECORD, SEGMENTATION, PICTURE)):
        return None
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        found = dict(record["found"]) if (record["schema"], record["settings"]) == (SCHEMA, settings) else None
        whole = found is not None and load_anatomy(folder, passages=False).digest == found["digest"]
    except (ValueError, LookupError, TypeError, NarisError):
        return None  # a record or an anatomy that was changed by hand is made anew
    return found | _places(folder, already=True) if found is not None and whole else None


def _places(folder: Path, *, already: bool, replaced: str | None = None) -> dict[str, Any]:
    from naris.anatomy.folder import region_sets_in

    kept = {"folder": folder, "segmentation": folder / SEGMENTATION, "picture": folder / PICTURE}
    return kept | {"already": already, "replaced": replaced, "region_sets": list(region_sets_in(folder))}


def _values(scan: Scan) -> str:
    """What tells a scan from others: its values, because names of files and series may name a person."""
    import hashlib

    import numpy as np

    return f"values {hashlib.sha256(np.ascontiguousarray(scan.volume.hu).tobytes()).hexdigest()[:16]}"


def _describe(made: ScannedAnatomy, airway: Airway, findings: tuple[Finding, ...]) -> dict[str, Any]:
    from naris.airway.segment import SEGMENTS
    from naris.cli.anatomy import nasal_frame

    return {
        "usable": True,
        "name": made.anatomy.name,
        "source": made.anatomy.source,
        "digest": made.anatomy.digest,
        "frame": made.anatomy.frame,
        "volume_ml": {name: round(airway.volume_ml(i + 1), 2) for i, name in enumerate(SEGMENTS)},
        "step_mm": airway.block.step_mm,
        "faces": len(made.anatomy.faces),
        "genus": made.genus,
        "smoothed_mm": {"mean": round(float(made.moved_mm.mean()), 3), "most": round(float(made.moved_mm.max()), 3)},
        "passages": [{"name": one.name, "length_mm": round(one.length_mm, 1)} for one in made.anatomy.passages],
        "landmarks_mm": {name: point.round(2).tolist() for name, point in made.anatomy.landmarks_mm.items()},
        "nasal_frame": nasal_frame(made.anatomy),
        "findings": [one.to_json() for one in findings],
    }


def _write_picture(made: ScannedAnatomy, airway: Airway, data: dict[str, Any], folder: Path) -> None:
    from naris.core.atomic import write_text
    from naris.report.anatomy_page import anatomy_page

    facts = {
        "from": data["source"],
        "air": ", ".join(f"{name} {ml:.1f} ml" for name, ml in data["volume_ml"].items() if ml),
        "surface": f"{data['faces']:,} faces, closed, genus {data['genus']}",
        "to know": "; ".join(f"{one['weight']}: {one['text']}" for one in data["findings"]) or NOTHING_UNUSUAL,
    }
    write_text(folder / PICTURE, anatomy_page(made.anatomy, made.anatomy.region_set().name, facts, airway.block))


def _text(data: dict[str, Any]) -> str:
    lines = [data["name"], f"  from      {data['source']}"]
    lines += [f"  {name:<24}{ml:6.1f} ml" for name, ml in data["volume_ml"].items() if ml]
    lines.append(f"  surface   {data['faces']:,} faces, closed, genus {data['genus']}")
    lines += [f"  {one['weight']}: {one['text']}" for one in data["findings"]]
    hint = f"the paper's four slabs; for anatomical ones: naris anatomy transfer {data['folder']} -o DIR"
    lines.append(f"  regions   {hint if len(data['region_sets']) < 2 else ', '.join(data['region_sets'])}")
    lines.append(f"kept in {data['folder']}, picture in {data['picture']}, for 3D Slicer {data['segmentation']}")
    return "\n".join(lines)
