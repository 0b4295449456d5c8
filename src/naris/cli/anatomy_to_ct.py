"""Make the CT that a scanner would make of an anatomy whose truth is known: partial volume, noise, tilt, metal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven
from naris.errors import InputError

if TYPE_CHECKING:
    from naris.core.volume import Volume

NRRD = ".nrrd"
_OTHER_FILES = (".nii", ".gz", ".mha", ".mhd", ".dcm", ".nhdr", ".ply", ".stl")


@dataclass(frozen=True)
class Options:
    """Which anatomy, how it is scanned, and where to."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """`builtin`, a surface file in mm (PLY, STL, OBJ, VTP), or a folder made by naris anatomy; in LPS, around its
    air."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.nrrd|DIR")]
    """A new file whose name ends in .nrrd, or a new or empty folder for a DICOM series."""
    spacing_mm: tuple[float, float, float] = (0.5, 0.5, 1.0)
    """Of the voxels: to the left, backwards and from slice to slice; each above 0."""
    thickness_mm: Annotated[IfGiven[float], tyro.conf.arg(metavar="MM")] = None
    """Of a slice, above 0; when not given, the distance to the next."""
    blur_mm: float = 0.4
    """Standard deviation of the point spread within a slice; 0 for none."""
    noise_hu: float = 25.0
    """Standard deviation of the noise; 0 for none."""
    tilt_deg: float = 0.0
    """Of the gantry, about the axis from ear to ear; at most 30 either way."""
    metal: int = 0
    """Fillings in the upper teeth, with their streaks; 0 to 64."""
    seed: int = 0
    """Of noise and metal."""


def run(options: Options, console: Console) -> int:
    """Scans the anatomy and writes the scan."""
    from naris.anatomy.folder import load_anatomy
    from naris.anatomy.virtual_ct import Scanner, virtual_ct
    from naris.ct.write import check_series_folder, write_dicom, write_nrrd

    scanner = Scanner(
        options.spacing_mm,
        options.thickness_mm,
        blur_mm=options.blur_mm,
        noise_hu=options.noise_hu,
        tilt_deg=options.tilt_deg,
        metal=options.metal,
    )
    is_file = _is_file(options.out)
    if not is_file:
        check_series_folder(options.out)
    anatomy = load_anatomy(options.anatomy, passages=False)
    volume = virtual_ct(anatomy, scanner, options.seed, console.progress)
    if is_file:
        write_nrrd(volume, options.out)
    else:
        write_dicom(volume, options.out, f"naris {anatomy.digest[:12]}", console.progress)  # a name may be a person's
    data = _describe(volume, options.out, "NRRD" if is_file else "DICOM", anatomy.digest)
    shape, spacing = ("×".join(f"{number:g}" for number in data[key]) for key in ("shape", "spacing_mm"))
    console.answer(data, f"{data['format']} CT of {anatomy.name}: {shape} voxels of {spacing} mm in {options.out}")
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"{options.out} is whole, missing or, if it is a folder, to be removed; run the same command again"


def _is_file(out: Path) -> bool:
    """Whether a new NRRD file is asked for, and not a folder.

    Raises:
        InputError: if it is there already, or its name ends as that of another kind of file.
    """
    suffix = out.suffix.lower()
    if suffix in _OTHER_FILES:
        raise InputError(
            f"a file whose name ends in {NRRD}, or a folder",
            out.name,
            f"name it {out.stem.removesuffix('.nii')}{NRRD}",
        )
    if suffix == NRRD and out.exists():
        raise InputError(f"a new file at {out}", "one that is there", "name another")
    return suffix == NRRD


def _describe(volume: Volume, out: Path, kind: str, digest: str) -> dict[str, Any]:
    return {
        "scan": out,
        "format": kind,
        "anatomy_digest": digest,
        "shape": list(volume.shape),
        "spacing_mm": [round(edge, 4) for edge in volume.spacing_mm.tolist()],
        "frame_T_index": volume.frame_T_index.tolist(),
    }
