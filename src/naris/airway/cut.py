"""The part of a scan around the anatomy that was found in it, kept beside it, so that later pictures show it as well.

It holds values and where they lie, nothing else of a header. Its name carries the digest of the values of the scan,
which the anatomy's source tells, too: the cut of another scan is never taken for its own.
"""

from __future__ import annotations

import logging
import re
import shutil
from pathlib import Path

import numpy as np
from jaxtyping import Float

from naris.airway.block import Block
from naris.core.atomic import replacing
from naris.core.volume import Volume
from naris.ct.files import read_file
from naris.ct.write import write_nrrd
from naris.errors import ScanError

log = logging.getLogger(__name__)

_MARGIN_MM = 10.0  # around the anatomy, a little more than pictures show
_VALUES = re.compile(r"\bvalues ([0-9a-f]{16})\b")
_CUTS = "scan-" + "[0-9a-f]" * 16 + ".nrrd"


def cut_path(folder: Path, source: str) -> Path | None:
    """Where the cut of the scan that a source tells lies in a folder, or would; None where it tells of no scan."""
    found = _VALUES.search(source)
    return folder / f"scan-{found[1]}.nrrd" if found else None


def write_cut(block: Block, bounds_mm: Float[np.ndarray, "2 3"], source: str, folder: Path) -> None:
    """Keep the part of a block around an anatomy with these bounds; cuts of other scans there are removed.

    Raises:
        DiskFull: if there is no room.
    """
    path = cut_path(folder, source)
    _remove_others(folder, path)
    if path is None:
        return
    low, high = block.index(bounds_mm[0] - _MARGIN_MM), block.index(bounds_mm[1] + _MARGIN_MM) + 1
    hu = block.hu[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    matrix = block.frame_T_index
    matrix[:3, 3] = block.points_mm(low)
    write_nrrd(Volume(np.rint(hu).astype(np.int16), matrix), path)


def read_cut(folder: Path, source: str) -> Block | None:
    """The cut in a folder of the scan that a source tells; None, with a warning, where it is damaged."""
    path = cut_path(folder, source)
    if path is None or not path.is_file():
        return None
    try:
        volume = read_file(path).volume
    except ScanError as error:
        log.warning("the scan is not drawn: %s", error)
        return None
    step_mm = float(volume.spacing_mm[0])
    if not np.allclose(volume.frame_T_index[:3, :3], step_mm * np.eye(3), atol=1e-6):
        log.warning("the scan is not drawn: expected even steps along x, y and z in %s, got others", path)
        return None
    return Block(volume.hu.astype(np.float32), np.array(volume.frame_T_index[:3, 3]), step_mm)


def carry_cut(source: str, folder: Path, other: Path) -> None:
    """Keep the cut of a scan in another folder as well, where there is one.

    Raises:
        DiskFull: if there is no room.
    """
    path, target = cut_path(folder, source), cut_path(other, source)
    _remove_others(other, target)
    if path is not None and target is not None and path.is_file() and path.resolve() != target.resolve():
        with replacing(target) as part:
            shutil.copyfile(path, part)


def _remove_others(folder: Path, own: Path | None) -> None:
    for path in folder.glob(_CUTS):
        if path != own:
            path.unlink()
