"""An answer outside of a region that somebody named contradicts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.core.pose import Pose
from naris.register.astray import BESIDE_MM
from naris.register.named import unless_elsewhere
from naris.register.register import RegisterConfig, register
from naris.register.starts import in_region


def test_what_ends_elsewhere_is_refused_and_says_where(prepared_nose, trials) -> None:
    regions, trial = prepared_nose.anatomy.region_set(), trials[0]
    here = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
    found = register(prepared_nose, trial.observation("a"), in_region(regions, here), RegisterConfig(seed=0))
    assert unless_elsewhere(found, regions, here) is found
    label = regions.label(found.best.position_mm + 30.0 * np.eye(3)[[1, 1]] * [[1], [-1]])
    other = next(regions.names[k] for k in label if k >= 0 and regions.names[k] != here)
    refused = unless_elsewhere(found, regions, other)
    assert refused.status == "refused" and refused.anatomy_T_camera is None
    assert refused.reason is not None and f"is in {here}, not in {other}" in refused.reason
    assert unless_elsewhere(refused, regions, here) is refused


@pytest.mark.parametrize(("beyond_mm", "status"), [(0.8, "registered"), (1.2, "refused")])
def test_beside_the_border_it_is_not(beyond_mm, status, prepared_nose, trials) -> None:
    """A step over it is no further than a pose may be off."""
    regions, trial = prepared_nose.anatomy.region_set(), trials[0]
    found = register(prepared_nose, trial.observation("a"), config=RegisterConfig(seed=0))
    inside = int(regions.label(found.best.position_mm))
    line = found.best.position_mm + np.linspace(0, 60, 1201)[:, None] * [0.0, 1.0, 0.0]
    border = line[np.flatnonzero(regions.label(line) != inside)[0]]
    at_mm = border + beyond_mm * BESIDE_MM * np.array([0.0, 1.0, 0.0])
    moved = Pose.of(found.best.rotation, at_mm, found.best.target, found.best.source)
    assert (
        unless_elsewhere(replace(found, anatomy_T_camera=moved, best=moved), regions, regions.names[inside]).status
        == status
    )
