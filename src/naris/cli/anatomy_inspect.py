"""Say what a scan is and whether it will do: is an airway found, all of it, how coarsely; metal; an open mouth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.ct.scan import Scan

NO_AIRWAY = 1


@dataclass(frozen=True)
class Options:
    """Which scan."""

    scan: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCAN")]
    """A DICOM folder or file, or a .nrrd, .nii, .nii.gz, .mha or .mhd file, in Hounsfield units."""
    series: Annotated[IfGiven[str], tyro.conf.arg(metavar="KEY")] = None
    """Which DICOM series, where a folder holds several (the message that says so lists them)."""


def run(options: Options, console: Console) -> int:
    """Reads the scan and looks at it; exit status 1 where it holds no nose to work with."""
    from naris.airway.fitness import inspect_scan
    from naris.ct.read import read_scan

    scan = read_scan(options.scan, options.series, console.progress)
    with console.progress.task("looking", 1) as advance:
        found = inspect_scan(scan)
        advance(1)
    data = scan_data(scan) | found.to_json()
    console.answer(data, _text(data))
    return 0 if found.usable else NO_AIRWAY


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "nothing is ever kept by this command"


def scan_data(scan: Scan) -> dict[str, Any]:
    """What is known of a scan without looking for a nose in it."""
    low, high = scan.volume.bounds_mm.round(1).tolist()
    return {
        "format": scan.format,
        "frame": scan.volume.frame,
        "shape": list(scan.volume.shape),
        "spacing_mm": [round(edge, 4) for edge in scan.volume.spacing_mm.tolist()],
        "slice_mm": round(scan.slice_mm, 4),
        "bounds_mm": {"low": low, "high": high},
        "hu": [int(scan.volume.hu.min()), int(scan.volume.hu.max())],
    }


def _text(data: dict[str, Any]) -> str:
    lines = [
        "an airway was found" if data["usable"] else f"no usable airway: {data['reason']}",
        f"  {scan_text(data)}",
    ]
    if data["reach_mm"]:
        reach = ", ".join(f"{name} {mm:.0f} mm" for name, mm in data["reach_mm"].items())
        lines.append(f"  beyond the tip of the nose: {reach}")
    if data["step_mm"]:
        lattice = f"on a lattice of {data['step_mm']:g} mm"
        lines.append(f"  volumes at a glance, {lattice}; naris anatomy from-ct measures them:")
    lines += [f"  {name:<24}{ml:6.1f} ml" for name, ml in data["volume_ml"].items() if ml]
    lines += [f"  {one['weight']}: {one['text']}" for one in data["findings"]]
    return "\n".join(lines)


def scan_text(data: dict[str, Any]) -> str:
    """The same in a line, so that a wrong header is seen."""
    shape, spacing = ("×".join(f"{number:g}" for number in data[key]) for key in ("shape", "spacing_mm"))
    edges = zip(data["bounds_mm"]["low"], data["bounds_mm"]["high"], strict=True)
    size = "×".join(f"{high - low:.0f}" for low, high in edges)
    return (
        f"{data['format']}, {shape} voxels of {spacing} mm, {data['hu'][0]} to {data['hu'][1]} HU, "
        f"{size} mm from right to left, front to back and bottom to top"
    )
