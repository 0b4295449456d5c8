"""Which positions of a pass are kept."""

from __future__ import annotations

import numpy as np

from naris.core.pose import Pose
from naris.dataset.pilot import _run
from naris.render.viewpoints import Viewpoints


def test_no_start_of_a_run_is_preferred() -> None:
    """A long stretch and a single position: all six positions come up alike."""
    position = np.array([0, 1, 2, 3, 4, 7])
    pose = Pose(np.tile(np.eye(4), (6, 1, 1)), "LPS", "camera")
    views = Viewpoints(pose, np.zeros(6, dtype=int), np.zeros(6, dtype=int), position)
    rng, usable = np.random.default_rng(0), np.ones(6, dtype=bool)
    drawn = np.concatenate([_run(views, usable, 1, 1, rng) for _ in range(3000)])
    counts = np.bincount(drawn, minlength=8)[position]
    assert counts.min() > 400
    assert counts.max() < 600
