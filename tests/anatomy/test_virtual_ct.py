"""A simulated CT shows the anatomy where it is, with its wall half-way between air and tissue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume
from naris.ct.read import read_scan
from naris.ct.resample import sampled, upright
from naris.ct.write import write_dicom
from naris.errors import InputError
from tests import simulated_head
from tests.anatomy.shapes import sphere, torus
from tests.winding_tube import winding_tube

CLEAN = Scanner(noise_hu=0.0)
COARSE = Scanner(spacing_mm=(0.8, 0.8, 1.6), noise_hu=0.0)
HALF_HU = (-1000 + 40) / 2


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return simulated_head.nose()


@pytest.fixture(scope="module")
def nose_ct(nose: Anatomy) -> Volume:
    return virtual_ct(nose, replace(COARSE, metal=3))


@pytest.mark.parametrize("shape", [sphere, torus, winding_tube], ids=["sphere", "torus", "tube"])
def test_the_wall_lies_half_way_between_air_and_tissue(shape) -> None:
    anatomy = shape()
    volume = virtual_ct(anatomy, replace(CLEAN, spacing_mm=(0.5, 0.5, 0.5)))
    inward = -vertex_normals(anatomy)
    at_mm = np.arange(-1.0, 1.01, 0.05)  # across the wall, from the tissue into the air
    hu = sampled(volume, anatomy.vertices_mm[:, None] + at_mm[:, None] * inward[:, None])
    crossing = at_mm[np.argmax(hu < HALF_HU, axis=1)]
    assert abs(np.median(crossing)) < 0.1
    assert np.percentile(np.abs(crossing), 95) < 0.3


def vertex_normals(anatomy: Anatomy) -> np.ndarray:
    """Outward unit normals by the areas of the faces around a vertex."""
    a, b, c = (anatomy.vertices_mm[anatomy.faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    normals = np.zeros_like(anatomy.vertices_mm)
    for k in range(3):
        np.add.at(normals, anatomy.faces[:, k], area)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_air_and_tissue_have_their_numbers() -> None:
    volume = virtual_ct(sphere(), Scanner(noise_hu=20.0))
    centre = sampled(volume, np.random.default_rng(0).uniform(-8, 8, (2000, 3)))
    assert abs(centre.mean() + 1000) < 4
    assert 8 < centre.std() < 20  # less than the noise, since it is interpolated
    around = np.random.default_rng(1).normal(size=(2000, 3))
    far = sampled(volume, 25.0 * around / np.linalg.norm(around, axis=1, keepdims=True))
    assert abs(np.median(far) - 40) < 4


def test_a_thick_slice_averages_over_its_thickness() -> None:
    """At the pole of a ball a slice of 4 mm shows the mean of the cap and what is above it."""
    thick = virtual_ct(sphere(), replace(CLEAN, spacing_mm=(1.0, 1.0, 1.0), thickness_mm=4.0))
    at_pole = float(sampled(thick, np.array([[0.0, 0.0, 20.0]]))[0])
    above = float(sampled(thick, np.array([[0.0, 0.0, 21.5]]))[0])
    assert at_pole == pytest.approx(HALF_HU, abs=150)  # bone lies above
    assert -420 < above < 250


def test_a_tilted_gantry_shows_the_same_places(tmp_path: Path) -> None:
    tube = winding_tube()
    tilted = virtual_ct(tube, replace(CLEAN, tilt_deg=12.0))
    assert tilted.skew_deg == pytest.approx(12.0, abs=1e-6)
    write_dicom(tilted, tmp_path / "scan", "tilted")
    scan = read_scan(tmp_path / "scan")
    assert "tilt" in {finding.code for finding in scan.findings}
    places = np.random.default_rng(0).uniform([-8, -25, -6], [8, 25, 6], (4000, 3))
    straight = sampled(virtual_ct(tube, CLEAN), places)
    for other in (upright(tilted), scan.volume):
        off = np.abs(sampled(other, places) - straight)
        assert np.median(off) < 15
        assert np.percentile(off, 95) < 250  # within a voxel of the wall the two lattices differ


def test_the_same_seed_gives_the_same_bits() -> None:
    one, same, other = (virtual_ct(sphere(), Scanner(metal=1), seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(one.hu, same.hu)
    assert not np.array_equal(one.hu, other.hu)


def test_the_nostrils_are_open_and_the_nose_is_closed_elsewhere(nose: Anatomy, nose_ct: Volume) -> None:
    for side in ("left", "right"):
        nostril = nose.landmarks_mm[f"{side}.nostril"]
        down = nostril + np.arange(0, 12, 0.25)[:, None] * np.array([0, 0, -1.0])
        assert sampled(nose_ct, down).max() < -800
        outward = 1.0 if side == "left" else -1.0
        across = nose.landmarks_mm[f"{side}.valve"] + np.arange(0, 14, 0.25)[:, None] * np.array([outward, 0, 0])
        assert sampled(nose_ct, across).max() > -100


@pytest.mark.long
def test_a_nose_that_a_scanner_put_elsewhere_has_the_same_head(nose: Anatomy) -> None:
    """Scanners begin anywhere: whole steps of the lattice away, the values are the same."""
    away = np.array([-110.0, -300.0, -530.0])
    marks = {name: point + away for name, point in nose.landmarks_mm.items()}
    moved = Anatomy(nose.vertices_mm + away, nose.faces, nose.frame, "moved", "a test", landmarks_mm=marks)
    here, there = (virtual_ct(one, COARSE) for one in (nose, moved))
    np.testing.assert_allclose(there.frame_T_index[:3, 3], here.frame_T_index[:3, 3] + away, atol=1e-6)
    assert np.mean(np.abs(there.hu.astype(float) - here.hu) > 5) < 1e-3


def test_metal_is_bright_and_casts_streaks(nose: Anatomy, nose_ct: Volume) -> None:
    clean = virtual_ct(nose, COARSE)
    assert nose_ct.hu.max() > 2500
    assert clean.hu.max() < 1000
    off = np.abs(nose_ct.hu.astype(int) - clean.hu)
    cut = (nose_ct.hu > 2500).any(axis=(0, 1))
    assert (off[:, :, cut] > 50).mean() > 0.05
    assert off[:, :, -20:].max() == 0


@pytest.mark.parametrize("absurd", [
    {"spacing_mm": (0.05, 0.05, 0.05)}, {"thickness_mm": 1000.0}, {"noise_hu": 1e9}, {"spacing_mm": (90.0, 90.0, 90.0)}
])  # fmt: skip
def test_what_no_scanner_does_is_refused(absurd) -> None:
    with pytest.raises(InputError, match="no scanner"):
        replace(COARSE, **absurd)


def test_what_cannot_be_scanned_is_refused() -> None:
    with pytest.raises(InputError, match="an anatomy in LPS"):
        virtual_ct(replace(sphere(), frame="mean"))
    with pytest.raises(InputError, match="above 0"):
        Scanner(spacing_mm=(0.5, 0.5, 0.0))
    with pytest.raises(InputError, match="above 0"):
        Scanner(noise_hu=float("nan"))
    with pytest.raises(InputError, match="30°"):
        Scanner(tilt_deg=45.0)


@pytest.mark.long
def test_the_nostrils_of_a_nose_that_was_found_in_a_scan_are_open_too() -> None:
    """Its landmarks lie outside of its lumen, which ends where the room began: no plug may be between the two."""
    found = simulated_head.found().anatomy
    again = virtual_ct(found, Scanner(spacing_mm=(0.6, 0.6, 1.0), noise_hu=0.0))
    for side in ("left", "right"):
        x, y, z = found.landmarks_mm[f"{side}.nostril"].tolist()
        straight_down = np.array([[x, y, z + height] for height in np.arange(4.0, -6.0, -0.5)])
        hu = again.hu[tuple(np.rint(again.index(straight_down)).astype(int).T)]
        assert (hu < -500).all(), side
