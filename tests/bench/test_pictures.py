"""The benchmarks of pictures alone, in small: all that was tried is counted, and what a real shot is compared with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench import BenchRequest, pictures, shot
from naris.bench.trials import FRAME_PX, drawn_trials
from naris.core.camera import Brown, Intrinsics
from naris.core.results import DepthEstimate
from naris.locate.depth import FOV_DEG
from naris.register.map import registration_map
from tests import simulated_head
from tests.register.sfm.simulated import reconstructed


@pytest.mark.long
def test_a_quick_run_counts_all_that_was_tried() -> None:
    told = {one.name: one for one in pictures.figures(BenchRequest(True, only="pictures"))}
    n = pictures.QUICK_PATIENTS * pictures.QUICK_VIEWS
    for kind in (pictures.NONE, pictures.REGION):
        assert told[f"register.picture.{kind}.success"].n == n
        assert (told[f"register.picture.{kind}.cpu_s"].value or 0) > 0
    assert told["register.picture.along.success"].n == told["register.picture.along.wrong_patient.refused"].n == 1
    accepted = told["register.picture.accepted"]
    assert told["register.picture.false_accept"].n == round((accepted.value or 0) * accepted.n)
    assert (told["register.picture.wrong_patient.refused"].value or 0) >= 0.6


def test_lenses_are_those_that_the_network_knows_and_show_all_of_their_picture() -> None:
    rng = np.random.default_rng(0)
    lenses = [pictures.lens(rng) for _ in range(60)]
    angles = np.array([one.vertical_fov_deg for one in lenses])
    assert FOV_DEG[0] < angles.min() < 50 and 80 < angles.max() < FOV_DEG[1]
    assert {one.height for one in lenses} == {FRAME_PX}
    assert len({one.width for one in lenses}) == len(pictures.SHAPES)
    assert all(np.isfinite(one.rays()).all() for one in lenses)
    assert 10 < sum(isinstance(one.lens, Brown) for one in lenses) < 50


def test_without_the_shot_its_figures_have_no_value(tmp_path: Path) -> None:
    told = shot.figures(BenchRequest(True, scans=tmp_path, only="shot"))
    assert [one.value for one in told] == [None] * 7


def seen(ranges: np.ndarray) -> tuple[DepthEstimate, np.ndarray]:
    """What a network tells, and points that lie so far away in half that unit."""
    rays = Intrinsics.from_vertical_fov(24, 24, 60.0).rays()
    none = np.full(ranges.shape, 0.1)
    return DepthEstimate(rays, ranges, none, 0.1, 20.0, 0.2), (0.5 * rays * ranges[..., None]).reshape(-1, 3)[::7]


def test_ranges_of_another_unit_are_alike() -> None:
    ranges = np.random.default_rng(0).uniform(3.0, 20.0, (24, 24))
    estimate, points = seen(ranges)
    correlation, off, spread = shot.alike(estimate, points)
    assert correlation == pytest.approx(1.0)
    assert off == pytest.approx(0.0, abs=1e-9)
    assert spread > 0.1


def test_ranges_of_something_else_are_not() -> None:
    rng = np.random.default_rng(0)
    estimate, _ = seen(rng.uniform(3.0, 20.0, (24, 24)))
    _, points = seen(rng.uniform(3.0, 20.0, (24, 24)))
    correlation, off, spread = shot.alike(estimate, points)
    assert abs(correlation) < 0.35
    assert off > spread
    assert all(np.isnan(shot.alike(estimate, points[:5])))


@pytest.mark.long
def test_a_shot_is_registered_to_its_own_nose_and_more_often_refused_by_another() -> None:
    """Points of some views, of a unit of their own, with noise as is usual."""
    nose = simulated_head.bare_nose()
    own, other = registration_map(nose, places_mm=2.0), registration_map(virtual_patient(77, 1))
    told = []
    for seed, trial in enumerate(drawn_trials(nose, 6, 11)):
        made, _ = reconstructed(nose, trial.anatomy_T_camera, seed, views=4, points=400)
        told.append([shot._refused(at, made, made.views[0], 1.0, alone=False) for at in (own, other)])
    by_own, by_other = np.mean(told, axis=0)
    assert by_own <= 0.34
    assert by_other > by_own
