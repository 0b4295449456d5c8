"""Where slices lie: the equation of the DICOM standard for single pixels is the oracle for whole stacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from naris.ct.slices import Plane, stacked
from naris.errors import ScanError

SEEDS = st.integers(0, 2**32 - 1)


def series(
    seed: int = 0,
    count: int = 20,
    step_mm: float = 1.5,
    tilt_deg: float = 0.0,
    spacing_mm: tuple[float, float] = (0.4, 0.6),
) -> list[Plane]:
    """Slices in a random orientation; a tilted gantry shifts each against the one before, along the columns."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    first = rng.normal(size=3) * 100
    way = step_mm * (turn[:, 2] + np.tan(np.deg2rad(tilt_deg)) * turn[:, 1])
    return [Plane(first + k * way, turn[:, 0], turn[:, 1], spacing_mm, (64, 48)) for k in range(count)]


def pixel_mm(plane: Plane, i: float, j: float) -> np.ndarray:
    """DICOM PS3.3, equation C.7.6.2.1-1."""
    return plane.position_mm + i * plane.spacing_mm[0] * plane.along_row + j * plane.spacing_mm[1] * plane.along_column


@given(seed=SEEDS, tilt_deg=st.floats(-25, 25), step_mm=st.floats(0.2, 5))
def test_every_pixel_of_a_shuffled_series_is_where_its_own_header_puts_it(
    seed: int, tilt_deg: float, step_mm: float
) -> None:
    planes = series(seed, 12, step_mm, tilt_deg)
    rng = np.random.default_rng(seed)
    shuffled = [planes[k] for k in rng.permutation(len(planes))]
    stack = stacked(shuffled)
    matrix = stack.frame_T_index()
    for k, number in enumerate(stack.order):
        i, j = rng.uniform(0, 60, 2)
        np.testing.assert_allclose(matrix[:3] @ [i, j, k, 1], pixel_mm(shuffled[number], i, j), atol=1e-6)
    assert np.linalg.det(matrix[:3, :3]) > 0
    assert stack.tilt_deg == pytest.approx(abs(tilt_deg), abs=1e-4)
    assert stack.step_mm == pytest.approx(step_mm)
    assert not stack.slices_missing


@pytest.mark.parametrize("absent", [[7], [7, 8], [3, 11, 12, 13]])
def test_missing_slices_are_counted_and_no_matrix_is_given(absent: list[int]) -> None:
    stack = stacked([plane for k, plane in enumerate(series()) if k not in absent])
    assert stack.slices_missing == len(absent)
    assert not stack.is_even
    with pytest.raises(ScanError, match=r"equal distances.*1\.5 to"):
        stack.frame_T_index()


def test_slices_that_change_their_distance_are_uneven_though_none_is_missing() -> None:
    planes = series(count=10, step_mm=1.0)
    way = planes[1].position_mm - planes[0].position_mm
    moved = [replace(plane, position_mm=plane.position_mm + 0.2 * (k >= 5) * way) for k, plane in enumerate(planes)]
    stack = stacked(moved)
    assert (stack.is_even, stack.slices_missing) == (False, 0)


@given(seed=SEEDS)
def test_positions_rounded_to_a_hundredth_of_a_mm_are_even_and_upright(seed: int) -> None:
    rounded = [replace(plane, position_mm=np.round(plane.position_mm, 2)) for plane in series(seed, 60)]
    stack = stacked(rounded)
    assert stack.is_even and stack.is_upright


def broken(kind: str) -> list[Plane]:
    planes = series()
    way = planes[1].position_mm - planes[0].position_mm
    turn = Rotation.from_rotvec(0.3 * planes[0].along_row).as_matrix()
    changes: dict[str, list[Plane]] = {
        "two": planes[:2],
        "copies": [*planes, planes[4]],
        "two mixed": [*planes, *[replace(one, position_mm=one.position_mm + 5e-3 * way) for one in planes]],
        "turned": [*planes[:-1], replace(planes[-1], along_column=turn @ planes[-1].along_column)],
        "size": [*planes[:-1], replace(planes[-1], shape=(32, 32))],
        "spacing": [*planes[:-1], replace(planes[-1], spacing_mm=(0.5, 0.6))],
        "aside": [*planes[:10], *[replace(one, position_mm=one.position_mm + one.along_row) for one in planes[10:]]],
    }
    return changes[kind]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("two", "at least 3 slices, got 2"),
        ("copies", "a place of its own"),
        ("two mixed", "a place of its own"),
        ("turned", r"one orientation, got some that are turned by 17\.2°"),
        ("size", "one size, got 32×32 and 64×48"),
        ("spacing", r"one pixel spacing"),
        ("aside", r"straight behind each other.*mm aside"),
    ],
)
def test_series_that_contradict_themselves_are_refused(kind: str, message: str) -> None:
    with pytest.raises(ScanError, match=message):
        stacked(broken(kind))


@pytest.mark.parametrize(
    "change",
    [
        {"position_mm": np.array([0, np.nan, 0])},
        {"spacing_mm": (0.0, 1.0)},
        {"along_row": np.array([2.0, 0, 0])},
        {"along_column": np.array([1.0, 0, 0])},
    ],
)
def test_headers_that_make_no_plane_are_refused(change: dict[str, object]) -> None:
    upright = Plane(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), (1.0, 1.0), (4, 4))
    with pytest.raises(ScanError):
        replace(upright, **change)  # type: ignore[arg-type]
