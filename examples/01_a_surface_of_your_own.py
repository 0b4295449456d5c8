"""From a surface file to an anatomy: what is checked, what is found, and which region a point lies in.

    python examples/01_a_surface_of_your_own.py [FOLDER] [SURFACE]

Without a surface the built-in nose is written as a PLY file in metres first, which is then read with the wrong unit and
with the right one.
"""

from __future__ import annotations

import sys
from pathlib import Path

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.distance import signed_distance
from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.anatomy.ply import write_surface
from naris.errors import SurfaceError


def main(folder: Path, surface: Path | None = None) -> None:
    """Reads a surface, describes it, and saves it as an anatomy that every `naris` command takes."""
    unit = "mm"
    if surface is None:
        folder.mkdir(parents=True, exist_ok=True)
        surface, unit = folder / "in_metres.ply", "m"
        nose = built_in_nose()
        write_surface(nose.with_(vertices_mm=nose.vertices_mm / 1000), surface)
        try:
            load_anatomy(surface)
        except SurfaceError as error:
            print(f"refused, as it should be: {error}")

    anatomy = load_anatomy(surface, unit=unit, regions="slabs")
    low, high = anatomy.bounds_mm
    print(f"{anatomy.name}: {len(anatomy.faces):,} triangles, {(high - low).round(1)} mm")
    for passage in anatomy.passages:
        tightest_mm = passage.clearance_mm.min()
        print(f"  passage {passage.name!r}: {passage.length_mm:.0f} mm, {tightest_mm:.1f} mm of room at least")

    # Positive inside the lumen. Regions label points; a picture's region is that of its camera.
    inside_mm = anatomy.passages[0].points_mm[::20]
    distance_mm = signed_distance(anatomy)(inside_mm)
    regions = anatomy.region_set()
    for point, depth, label in zip(inside_mm, distance_mm, regions.label(inside_mm), strict=True):
        print(f"  {point.round(1)} mm: {depth:+.1f} mm from the wall, in {regions.names[label]!r}")

    save_anatomy(anatomy, folder / "anatomy")
    print(f"wrote {folder / 'anatomy'}")


if __name__ == "__main__":
    arguments = [Path(argument) for argument in sys.argv[1:]]
    main(arguments[0] if arguments else Path("out/examples"), *arguments[1:2])
