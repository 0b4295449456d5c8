"""Deformations of a nose: as large, as smooth and as symmetric as asked, and nothing folds or is lost."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from naris.anatomy.checks import check_surface
from naris.anatomy.crossings import crossings, uncrossed
from naris.anatomy.distance import lumen_distance, signed_distance
from naris.anatomy.gaussian_process import Deformation, GaussianProcess
from naris.anatomy.nasal_cycle import NasalCycle
from naris.anatomy.triangles import index_triangles
from naris.core.anatomy import Anatomy
from naris.errors import InputError
from tests import simulated_head

EVERY = 4
"""A quarter of vertices and faces tells how far and how alike they move, and whether they fold."""

process_around = cache(GaussianProcess.around)


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return simulated_head.nose()


def shifts(process: GaussianProcess, count: int) -> np.ndarray:
    """(count, V / `EVERY`, 3) where every so many vertices go, of the process alone."""
    rng = np.random.default_rng(0)
    drawn = [[rng.standard_normal((basis.shape[1], n)) for basis, n in zip(process.basis, (1, 2), strict=True)]
             for _ in range(count)]  # fmt: skip
    some = [np.ascontiguousarray(basis[::EVERY]) for basis in process.basis]
    return np.stack([np.concatenate([b @ of for b, of in zip(some, one, strict=True)], axis=1) for one in drawn])


def folded(anatomy: Anatomy) -> float:
    """The share of faces beside which the surface does not wind once on the inside and not at all on the outside.

    Of every fourth face; where walls pass through each other, it winds twice or less than once.
    """
    corners = anatomy.vertices_mm[anatomy.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    middle, index = corners.mean(axis=1), index_triangles(anatomy.vertices_mm, anatomy.faces)
    inside, outside = (index.winding((middle + side * 0.02 * normal)[::EVERY]) for side in (-1, 1))
    return float(((inside != 1) | (outside != 0)).mean())


def test_a_crumpled_nose_is_seen_to_be_folded(nose: Anatomy) -> None:
    """The measure of the other tests: nothing on a nose, much on one whose vertices were shaken."""
    assert folded(nose) < 0.001
    shaken = nose.vertices_mm + 0.6 * np.random.default_rng(0).standard_normal(nose.vertices_mm.shape)
    assert folded(nose.with_(vertices_mm=shaken, passages=())) > 0.05


@pytest.mark.slow
def test_displacements_have_the_asked_covariance(nose: Anatomy) -> None:
    """Of one side alone (asymmetry 1): the amplitude everywhere, and exp(−½) of it a scale away."""
    process = GaussianProcess.around(nose, Deformation(amplitude_mm=1.5, scale_mm=15.0, asymmetry=1.0, cycle_mm=0.0))
    moved = shifts(process, 400)
    assert moved.std(axis=0).mean() == pytest.approx(1.5, rel=0.05)
    places = nose.vertices_mm[::EVERY]
    apart = np.linalg.norm(places[:, None] - places[None, ::100], axis=-1)
    far, near = np.argwhere(np.abs(apart - 15.0) < 0.05).T
    here, there = moved[:, far], moved[:, ::100][:, near]
    agreed = (here * there).mean() / np.sqrt((here**2).mean() * (there**2).mean())
    assert agreed == pytest.approx(np.exp(-0.5), abs=0.04)


@pytest.mark.slow
def test_the_amplitude_is_that_of_the_documents_with_two_sides(nose: Anatomy) -> None:
    """Up and back everywhere; across far from the middle, and less in it."""
    process = GaussianProcess.around(nose, Deformation(amplitude_mm=1.0, asymmetry=0.3, cycle_mm=0.0))
    sd = shifts(process, 400).std(axis=0)
    off = np.abs(nose.vertices_mm[::EVERY, 0])
    assert sd[:, 1:].mean() == pytest.approx(1.0, rel=0.06)
    assert sd[off < 2, 0].mean() < 0.8
    assert sd[off > 14, 0].mean() == pytest.approx(1.0, rel=0.12)


@pytest.mark.slow
def test_without_asymmetry_a_symmetric_nose_stays_so(nose: Anatomy) -> None:
    """Points and their mirror images go to mirror images, whatever is drawn."""
    process = GaussianProcess.around(nose, Deformation(asymmetry=0.0, cycle_mm=0.0))
    rng = np.random.default_rng(1)
    marks = nose.landmarks_mm
    middle = (marks["left.choana"][0] + marks["right.choana"][0]) / 2
    mirrored = nose.vertices_mm * [-1, 1, 1] + [2 * middle, 0, 0]
    off, twin = cKDTree(nose.vertices_mm).query(mirrored[:1000])
    close = off < 0.2
    assert close.sum() > 50
    for _ in range(3):
        drawn = [rng.standard_normal((b.shape[1], n)) for b, n in zip(process.basis, (1, 2), strict=True)]
        shift = np.concatenate([b @ of for b, of in zip(process.basis, drawn, strict=True)], axis=1)
        np.testing.assert_allclose(shift[:1000][close] * [-1, 1, 1], shift[twin[close]], atol=0.15)


@pytest.mark.long
def test_a_patient_is_whole_and_comes_of_seed_and_number_alone(nose: Anatomy) -> None:
    process = process_around(nose, Deformation())
    one = process.patient(5, 2)
    report = check_surface(one.vertices_mm, one.faces)
    assert report.closed
    assert not report.inside_out
    assert folded(one) < 0.001
    assert one.digest == GaussianProcess.around(nose).patient(5, 2).digest != process.patient(5, 3).digest
    assert 0.3 < np.linalg.norm(one.vertices_mm - nose.vertices_mm, axis=1).mean() < 3
    assert [passage.name for passage in one.passages] == [passage.name for passage in nose.passages]
    distance = lumen_distance(one)
    assert all((distance(passage.points_mm) > 0).all() for passage in one.passages)
    for name, regions in nose.regions.items():
        assert one.regions[name].names == regions.names
        there = nose.passages[0].points_mm
        agreed = one.regions[name].label(one.passages[0].points_mm[:: len(one.passages[0].points_mm) - 1])
        assert agreed.tolist() == regions.label(there[:: len(there) - 1]).tolist()


@pytest.mark.long
def test_the_nasal_cycle_swells_one_side_and_shrinks_the_other(nose: Anatomy) -> None:
    """Air of the left against air of the right: their ratio follows the cycle, and with none of it hardly moves."""

    def left_share(anatomy: Anatomy) -> float:
        distance = signed_distance(anatomy, 1.0, tissue_to_mm=2.0)
        nodes = distance.origin_mm + distance.spacing_mm * np.argwhere(distance.values_mm > 0)
        middle = np.mean([anatomy.landmarks_mm[f"{side}.choana"][0] for side in ("left", "right")])
        return float((nodes[:, 0] > middle).mean())

    process = GaussianProcess.around(nose, Deformation(amplitude_mm=0.0, cycle_mm=0.8))
    found = [process.patient(0, number) for number in range(6)]
    cycle = [float(one.source.split("nasal cycle ")[1].split(" mm")[0]) for one in found]
    shares = [left_share(one) for one in found]
    assert np.corrcoef(cycle, shares)[0, 1] < -0.95
    assert max(shares) - min(shares) > 0.04
    assert max(map(folded, found)) < 0.002


@pytest.mark.long
@pytest.mark.parametrize("deformation", [Deformation(), Deformation(amplitude_mm=2.0), Deformation(cycle_mm=1.0)])
def test_some_patients_do_not_cross_themselves(nose: Anatomy, deformation: Deformation) -> None:
    process = process_around(nose, deformation)
    assert process.crossings == 0
    for number in range(2):
        patient = process.patient(0, number)
        assert len(crossings(patient.vertices_mm, patient.faces)) == 0


@pytest.mark.long
def test_a_displacement_that_would_fold_space_does_not(nose: Anatomy) -> None:
    """In one step it would; walked in several it does not, and goes as far."""
    process = GaussianProcess.around(nose, Deformation(amplitude_mm=3.0, scale_mm=9.0, asymmetry=1.0, cycle_mm=0.0))
    moved, crossed = [], 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        drawn = [rng.standard_normal((b.shape[1], n)) for b, n in zip(process.basis, (1, 2), strict=True)]
        at_once = np.concatenate([b @ of for b, of in zip(process.basis, drawn, strict=True)], axis=1)
        crossed += len(crossings(nose.vertices_mm + at_once, nose.faces))
        vertices = process._deformed(drawn)
        assert len(crossings(vertices, nose.faces)) == 0
        moved.append(vertices - nose.vertices_mm)
    assert crossed > 0
    assert np.sqrt(np.mean(np.square(moved))) == pytest.approx(3.0, rel=0.1)


def test_the_cycle_leaves_air_before_every_wall_and_tissue_behind_it(nose: Anatomy) -> None:
    """However far it is asked to swell: the air that a wall swells into stays air, and the tissue behind stays."""
    cycle = NasalCycle.of(nose, 1.0, 0.0)
    distance = signed_distance(nose)
    for size in (-5.0, 5.0):
        shift = cycle.shift_mm(size)
        way = -(shift * cycle.towards).sum(axis=1)
        assert (way <= cycle.most_in_mm + 1e-9).all() and (way >= -cycle.most_out_mm - 1e-9).all()
        there = distance.exact(nose.vertices_mm + shift)
        far = np.abs(way) > 0.1
        assert far.mean() > 0.3
        assert (there[far] * np.sign(way[far]) > 0).mean() > 0.999
        moved = uncrossed(nose.vertices_mm, nose.vertices_mm + shift, nose.faces)
        assert (moved == nose.vertices_mm + shift).all(axis=1).mean() > 0.999


@pytest.mark.parametrize("wrong", [{"amplitude_mm": -1.0}, {"scale_mm": 0.0}, {"asymmetry": 1.5}, {"cycle_mm": np.nan}])
def test_impossible_numbers_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="a scale above 0"):
        Deformation(**wrong)


def test_a_scale_finer_than_the_nose_can_be_told_in_is_refused(nose: Anatomy) -> None:
    with pytest.raises(InputError, match="give a larger scale"):
        GaussianProcess.around(nose, Deformation(scale_mm=1.0))
