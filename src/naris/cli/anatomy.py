"""Look at an anatomy: unit, closedness, volume, regions, passages. With -o, keep it in a folder, with a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse

if TYPE_CHECKING:
    import numpy as np

    from naris.core.anatomy import Anatomy, Passage

PICTURE = "anatomy.html"
_ENDS_MM = 3.0


@dataclass(frozen=True)
class Options:
    """What to look at."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """`builtin`, a surface file (PLY, STL, OBJ, VTP), or a folder made by this command."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Keep the anatomy with its regions and passages in this folder, with a picture (anatomy.html)."""
    unit: IfGiven[Literal["mm", "cm", "m", "in", "um"]] = None
    """Of the numbers in a surface file; mm when not given. Not for any other anatomy."""
    frame: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME")] = None
    """Of the coordinates in a surface file: LPS, RAS or a name of its own; by default what the file says, else LPS.
    Not for any other anatomy."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME|FILE|slabs")] = None
    """Region set to put first: one of its own, a JSON file, or four even slabs from front to back; by default the order
    stays."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=NUMBER", help_behavior_hint="(optional)")] = ()
    """Parameters of the built-in nose (mm or degrees), e.g. cavity_length_mm=70; a wrong name lists them all."""


def run(options: Options, console: Console) -> int:
    """Reads or makes the anatomy, tells what it is, keeps it if asked."""
    from naris.airway.cut import carry_cut
    from naris.anatomy.folder import check_replaces, save_anatomy
    from naris.cli.anatomies import folder_of, is_whole_anatomy, open_anatomy, shaped_nose

    if is_whole_anatomy(options.anatomy):
        refuse(options, ("unit", "frame"), "only with a surface file", f"the anatomy {options.anatomy}")
    if options.set:
        anatomy = shaped_nose(options.anatomy, options.set)
        regions = anatomy.region_set(options.regions)
    else:
        unit = options.unit or "mm"
        anatomy, regions = open_anatomy(options.anatomy, options.regions, frame=options.frame, unit=unit)
    others = {name: one for name, one in anatomy.regions.items() if name != regions.name}
    anatomy = anatomy.with_(regions={regions.name: regions, **others})
    data = _describe(anatomy)
    if options.out is not None:
        check_replaces(anatomy.source, options.out)
        save_anatomy(anatomy, options.out)
        carry_cut(anatomy.source, folder_of(options.anatomy), options.out)
        draw_page(anatomy, options.out, data)
        data |= {"folder": options.out, "picture": options.out / PICTURE}
    console.answer(data, _text(data))
    return 0


def draw_page(anatomy: Anatomy, folder: Path, described: dict[str, Any] | None = None) -> None:
    """Writes the picture of an anatomy, with its first regions in colour, into its folder; it is described once."""
    from naris.airway.cut import read_cut
    from naris.core.atomic import write_text
    from naris.report.anatomy_page import anatomy_page

    facts, scan = _facts(described or _describe(anatomy)), read_cut(folder, anatomy.source)
    write_text(folder / PICTURE, anatomy_page(anatomy, anatomy.region_set().name, facts, scan))


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "nothing was kept; run the same command again"


def _describe(anatomy: Anatomy) -> dict[str, Any]:
    from naris.anatomy.checks import check_surface

    report = check_surface(anatomy.vertices_mm, anatomy.faces, find_crossings=True)
    low, high = anatomy.bounds_mm.tolist()
    return {
        "name": anatomy.name,
        "source": anatomy.source,
        "frame": anatomy.frame,
        "digest": anatomy.digest,
        "vertices": report.vertices,
        "faces": report.faces,
        "closed": report.closed,
        "pieces": report.pieces,
        "genus": report.genus,
        "crossings": report.crossings,
        "crossing_faces": report.crossing_faces,
        "volume_ml": round(report.volume_ml, 3),
        "bounds_mm": {"low": low, "high": high},
        "airspace": anatomy.airspace.kind,
        "regions": {name: list(one.names) for name, one in anatomy.regions.items()},
        "passages": [_passage(one) for one in anatomy.passages],
        "landmarks_mm": {name: point.tolist() for name, point in anatomy.landmarks_mm.items()},
        "nasal_frame": nasal_frame(anatomy),
    }


def nasal_frame(anatomy: Anatomy) -> dict[str, Any] | None:
    """The coordinates that mean the same in every nose, where the landmarks tell them."""
    from naris.core.nasal_frame import NasalFrame
    from naris.errors import InputError

    try:
        found = NasalFrame.of(anatomy.landmarks_mm)
    except InputError:
        return None
    return {"depth_mm": round(found.depth_mm, 2), "frame_T_nasal": found.frame_T_nasal.tolist()}


def _passage(passage: Passage) -> dict[str, Any]:
    return {
        "name": passage.name,
        "length_mm": round(passage.length_mm, 1),
        "clearance_least_mm": round(float(_on_the_way(passage).min()), 2),
        "clearance_most_mm": round(float(passage.clearance_mm.max()), 2),
    }


def _on_the_way(passage: Passage) -> np.ndarray:
    """The clearance but for the first and the last millimetres, where a surface ends and closes the way."""
    import numpy as np

    steps = np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    inner = (along >= _ENDS_MM) & (along <= passage.length_mm - _ENDS_MM)
    return passage.clearance_mm[inner] if inner.any() else passage.clearance_mm


def _facts(data: dict[str, Any]) -> dict[str, str]:
    low, high = data["bounds_mm"]["low"], data["bounds_mm"]["high"]
    extent = ", ".join(f"{axis} {a:.1f} … {b:.1f}" for axis, a, b in zip("xyz", low, high, strict=True))
    pieces = "one piece" if data["pieces"] == 1 else f"{data['pieces']} pieces"
    crossing = f"{data['crossing_faces']:,} faces cross others" if data["crossings"] else "no face crosses another"
    where = {"enclosed": "enclosed by the surface", "between": "between walls that the surface encloses"}
    return {
        "from": data["source"],
        "frame": f"{data['frame']}, {extent} mm",
        "surface": f"{data['vertices']:,} vertices, {data['faces']:,} faces, "
        f"{'closed' if data['closed'] else 'open'}, {pieces}, genus {data['genus']}, {crossing}",
        "encloses": f"{data['volume_ml']:.1f} ml",
        "air": where[data["airspace"]],
        "digest": data["digest"],
    }


def _text(data: dict[str, Any]) -> str:
    lines = [data["name"], *(f"  {label:<10}{told}" for label, told in _facts(data).items())]
    for name, names in data["regions"].items():
        lines.append(f"  regions {name}: {', '.join(names)}")
    if data["nasal_frame"]:
        lines.append(f"  nose      {data['nasal_frame']['depth_mm']:.0f} mm from the nostrils in to the choanae")
    for one in data["passages"]:
        room = f"room {one['clearance_least_mm']:.2f}–{one['clearance_most_mm']:.2f} mm to the wall"
        lines.append(f"  passage {one['name']}: {one['length_mm']:.0f} mm, {room}")
    if "folder" in data:
        lines.append(f"kept in {data['folder']}, picture in {data['picture']}")
    return "\n".join(lines)
