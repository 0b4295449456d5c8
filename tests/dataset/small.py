"""A small simulation in the winding tube, for this folder's tests and the processes that they start and kill."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.dataset.generate import Simulation
from naris.render.appearance import ENDOSCOPE, TRAINING_APPEARANCE, Appearance, AppearanceDistribution
from naris.render.viewpoints import Viewpoints
from tests.winding_tube import SLABS, centre_line, winding_tube

LOOKS: dict[str, Appearance | AppearanceDistribution] = {"endoscope": ENDOSCOPE, "training": TRAINING_APPEARANCE}


def small_simulation(count: int = 24, size_px: int = 40, seed: int = 7, look: str = "training") -> Simulation:
    """`count` views along the tube, two a position."""
    line = centre_line()
    at = np.linspace(5, len(line) - 30, count).astype(int) // 2 * 2
    poses = Pose.look(line[at], line[at + 20] - line[at], np.array([0, 0, 1.0]), "LPS")
    region = SLABS.label(poses.position_mm).astype(np.int64)
    views = Viewpoints(poses, region, np.zeros(count, np.int64), np.arange(count) // 2)
    camera = Intrinsics.from_vertical_fov(size_px, size_px, 60.0)
    return Simulation(
        winding_tube(), SLABS, views, camera, LOOKS[look], seed, views_from={"kind": "a test", "count": count}
    )


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder, hidden ones too."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
