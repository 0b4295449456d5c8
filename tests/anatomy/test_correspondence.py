"""Where points of one anatomy lie in another: on maps that are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from naris.anatomy.correspondence import LANDMARKS, correspond
from naris.core.anatomy import Anatomy, Between
from naris.errors import InputError
from tests.winding_tube import winding_tube

Map = Callable[[np.ndarray], np.ndarray]


def marked_tube() -> Anatomy:
    """With its landmarks spread along it."""
    tube = winding_tube()
    line = tube.passages[0].points_mm
    at = np.linspace(10, len(line) - 11, len(LANDMARKS)).astype(int)
    return tube.with_(landmarks_mm={name: line[i] for name, i in zip(LANDMARKS, at, strict=True)})


def moved(anatomy: Anatomy, by: Map, *, same_mesh: bool = False) -> Anatomy:
    """The anatomy after a map; its faces in another order unless the meshes shall correspond."""
    faces = anatomy.faces if same_mesh else np.ascontiguousarray(anatomy.faces[::-1])
    marks = {name: by(point) for name, point in anatomy.landmarks_mm.items()}
    return Anatomy(by(anatomy.vertices_mm), faces, anatomy.frame, "moved", "a test", landmarks_mm=marks)


def turned_and_stretched(points: np.ndarray) -> np.ndarray:
    axes = Rotation.from_rotvec([0.05, -0.1, 0.08]).as_matrix() @ np.diag([1.15, 0.93, 1.05])
    return points @ axes.T + [3.0, -2.0, 5.0]


def bent(points: np.ndarray) -> np.ndarray:
    """Thicker at one end than at the other, and bent."""
    y = points[..., 1]
    widened = points * np.stack([1 + 0.004 * y, np.ones_like(y), 1 + 0.004 * y], axis=-1)
    return widened + np.stack([2.5 * np.sin(y / 15), np.zeros_like(y), np.zeros_like(y)], axis=-1)


@pytest.mark.parametrize(("by", "most_mm"), [(turned_and_stretched, 0.15), (bent, 0.8)])
def test_a_known_map_is_found(by: Map, most_mm: float) -> None:
    tube = marked_tube()
    found = correspond(tube, moved(tube, by))
    line = tube.passages[0].points_mm[8:-8]
    off = np.linalg.norm(found(line) - by(line), axis=1)
    assert off.mean() < most_mm
    assert found.residual_mm.mean() < 0.3
    before = np.linalg.norm(line - by(line), axis=1).mean()
    assert off.mean() < 0.4 * before


def test_vertices_that_correspond_tell_themselves() -> None:
    tube = marked_tube()
    found = correspond(tube.with_(landmarks_mm={}), moved(tube, bent, same_mesh=True))
    chosen = tube.vertices_mm[::7]
    assert np.linalg.norm(found(chosen) - bent(chosen), axis=1).mean() < 0.25
    assert 0 < found.residual_mm.mean() < 0.25


def test_without_landmarks_in_common_nothing_is_guessed() -> None:
    tube = marked_tube()
    other = moved(tube, bent).with_(landmarks_mm={})
    with pytest.raises(InputError, match=r"4 or more of the landmarks .*left\.nostril.*got none"):
        correspond(tube, other)


def test_air_between_walls_is_refused() -> None:
    tube = marked_tube()
    with pytest.raises(InputError, match="encloses the air"):
        correspond(tube.with_(airspace=Between()), tube)
