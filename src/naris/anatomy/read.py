"""Reading surfaces."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from naris.anatomy.mean_nose import AIRSPACE
from naris.anatomy.regions import PAPER_SLABS
from naris.core.anatomy import Anatomy, Enclosed

MEAN_NOSE_SHA256 = "f35af2b9bcc6e323b580b4fb425a1604aacfed7443ea018362c7620b6be70c13"


def read_surface(path: str | Path, *, frame: str | None = None, unit: str = "mm") -> Anatomy:
    """The surface in a file, in mm."""
    import trimesh

    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    mesh = trimesh.load(str(path), process=False)
    mean = digest == MEAN_NOSE_SHA256
    return Anatomy(
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int32),
        frame or ("mean" if mean else "LPS"),
        "mean nose" if mean else Path(path).stem,
        f"{Path(path).name} (SHA-256 {digest})",
        regions={"paper": PAPER_SLABS} if mean else {},
        airspace=AIRSPACE if mean else Enclosed(),
    )
