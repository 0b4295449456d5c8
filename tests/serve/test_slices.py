"""Slices show the right values at the right side, and walls where the anatomy has them."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume
from naris.errors import ScanError
from naris.serve.slices import PLANES, WALL, Slices

SIZE, SPAN = 120, 60.0


def ramp(axis: int) -> Volume:
    """Values that grow by 10 HU a mm along an axis of the patient, on a lattice that lies askew and backwards."""
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]) @ np.diag([0.9, 1.1, 1.3])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    shape = np.array([140, 110, 90])
    matrix[:3, 3] = -turn @ (shape - 1) / 2
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    points = index @ turn.T + matrix[:3, 3]
    return Volume((10 * points[..., axis]).astype(np.float32), matrix)


def panels(picture: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(PLANES, np.split(picture, 3, axis=1), strict=True))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_picture_is_brighter_where_the_values_grow(anatomy: Anatomy, axis: int) -> None:
    slices = Slices(ramp(axis), signed_distance(anatomy))
    place = np.array([1.0, 5.0, -2.0])
    shown = panels(slices.picture(place, SPAN, SIZE, (10 * place[axis], 1000.0)))
    for name, (right, down) in PLANES.items():
        is_wall = (shown[name] == WALL).all(axis=2)
        grey = np.ma.array(shown[name][..., 0].astype(float), mask=is_wall)
        per_mm = 255 * 10 / 1000
        for direction, over in ((right, 1), (down, 0)):
            rise = np.diff(grey.mean(axis=1 - over))
            step = SPAN / SIZE * per_mm * direction[axis]
            assert np.ma.median(rise) == pytest.approx(step, abs=0.6), name
        middle = grey[SIZE // 2 - 2 : SIZE // 2 + 2, SIZE // 2 - 2 : SIZE // 2 + 2].mean()
        assert middle == pytest.approx(127.5, abs=3)


def test_walls_are_drawn_where_the_anatomy_has_them(anatomy: Anatomy) -> None:
    """The tube has a radius of 5 mm: in the coronal slice its wall is a ring of that size round the passage."""
    line = anatomy.passages[0].points_mm
    place = line[len(line) // 2]
    shown = panels(Slices(ramp(0), signed_distance(anatomy)).picture(place, SPAN, SIZE, (0.0, 1000.0)))
    row, column = np.nonzero((shown["coronal"] == WALL).all(axis=2))
    far = np.hypot(row + 0.5 - SIZE / 2, column + 0.5 - SIZE / 2) * SPAN / SIZE
    assert len(far) > 30
    assert far.min() > 4.0 and far.max() < 6.5


def test_another_scan_is_refused(anatomy: Anatomy) -> None:
    volume = ramp(0)
    matrix = volume.frame_T_index.copy()
    for off_mm in (500.0, 30.0):  # elsewhere; without a part of the anatomy
        moved = matrix.copy()
        moved[1, 3] += off_mm
        with pytest.raises(ScanError, match="the scan that the anatomy was found in"):
            Slices(Volume(volume.hu, moved), signed_distance(anatomy))
    with pytest.raises(ScanError, match="one in mean"):
        Slices(volume, signed_distance(anatomy.with_(frame="mean", regions={}, passages=())))
