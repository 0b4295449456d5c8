"""Other libraries that register clouds: right where they are installed, a sentence where they are not."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from naris.core.pose import Pose
from naris.errors import MachineError
from naris.register import libraries
from naris.register.libraries import LIBRARIES, NOT_INSTALLED, OPEN3D, Target, aligner, library_for, target_of
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


@pytest.mark.parametrize("name", LIBRARIES)
def test_what_is_not_installed_is_said(name: str, target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d" if name == OPEN3D else "small_gicp", None)
    assert aligner(name, target, (2.0,)) == NOT_INSTALLED


@pytest.mark.parametrize("name", LIBRARIES)
def test_what_is_installed_aligns(name: str, target: Target) -> None:
    ready = aligner(name, target, (4.0, 2.0))
    if isinstance(ready, str):
        pytest.skip(f"{name}: {ready}")
    pose = Pose.exp(np.array([0.8, -0.6, 0.5, 0.02, -0.03, 0.02]), "LPS", "cloud").matrix
    ended = ready(target.points[::50])(pose)
    np.testing.assert_allclose(ended, np.eye(4), atol=0.1)
    np.testing.assert_allclose(ended[:3, :3] @ ended[:3, :3].T, np.eye(3), atol=1e-12)


def test_what_rounding_left_of_a_rotation_becomes_one() -> None:
    pose = Pose.exp(np.array([1.0, 2.0, 3.0, 0.3, -0.2, 0.9]), "LPS", "cloud").matrix
    off = pose + np.vstack([1e-5 * np.random.default_rng(0).standard_normal((3, 4)), np.zeros(4)])
    cleaned = libraries._proper(off)
    np.testing.assert_allclose(cleaned[:3, :3] @ cleaned[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(cleaned, pose, atol=1e-4)
    np.testing.assert_array_equal(cleaned[:3, 3], off[:3, 3])


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_method_whose_library_is_missing_is_told_with_what_to_install(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(libraries, "missing", lambda _: NOT_INSTALLED)
    with pytest.raises(
        MachineError, match=rf"{name.lower()}.*not installed.*pip install 'naris\[(small-gicp|open3d)\]'"
    ):
        library_for(name, box())
