"""Other libraries that register clouds: right where they are installed, a sentence where they are not."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from naris.bench.point_peers import NOT_INSTALLED, OPEN3D, PEERS, Target, aligner, target_of
from naris.core.pose import Pose
from tests.anatomy.shapes import box


@pytest.fixture(scope="module")
def target() -> Target:
    anatomy = box()
    return target_of(anatomy.vertices_mm, anatomy.faces, 20_000, np.random.default_rng(0))


def test_the_target_lies_on_the_surface_with_outward_normals(target: Target) -> None:
    off = np.abs(np.abs(target.points) / [20.0, 30.0, 15.0] - 1).min(axis=1)
    assert off.max() < 1e-9
    np.testing.assert_allclose(np.linalg.norm(target.normals, axis=1), 1.0)
    assert ((target.points * target.normals).sum(axis=1) > 0).all()


@pytest.mark.parametrize("name", PEERS)
def test_what_is_not_installed_is_said(name: str, target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d" if name == OPEN3D else "small_gicp", None)
    assert aligner(name, target, (2.0,)) == NOT_INSTALLED


@pytest.mark.parametrize("name", PEERS)
def test_what_is_installed_aligns(name: str, target: Target) -> None:
    ready = aligner(name, target, (4.0, 2.0))
    if isinstance(ready, str):
        pytest.skip(f"{name}: {ready}")
    pose = Pose.exp(np.array([0.8, -0.6, 0.5, 0.02, -0.03, 0.02]), "LPS", "cloud").matrix
    ended = ready(target.points[::50])(pose)
    np.testing.assert_allclose(ended, np.eye(4), atol=0.1)
