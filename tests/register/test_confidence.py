"""A probability of what speaks for a pose, and covariances as large as errors are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.builtin.variation import virtual_patient
from naris.core.pose import CAMERA, Pose, distance
from naris.register import confidence
from naris.register.confidence import features, probability, refusal
from naris.register.evidence import Evidence
from naris.register.map import registration_map
from naris.register.noise import PointNoise
from naris.register.observation import from_points, together
from naris.register.register import RegisterConfig, register
from naris.register.solve import fine
from naris.register.starts import NOTHING, Starts

GOOD = Evidence(
    margin=40.0,
    rough_margin=20.0,
    sd_mm=0.2,
    sd_deg=0.5,
    within=0.99,
    explained=0.99,
    misfit=1.0,
    spread=1.0,
    kinship=0.0,
    excess=0.0,
    through=0.0,
    waves=1.0,
    ripples=1.0,
    plain=False,
    few=0.0,
    agreement=0.5,
    scatter=0.1,
    astray=0.1,
    dents=0.5,
    surprise=0.0,
    cloud=False,
    views=1,
    again=True,
    free=False,
    clearance_mm=2.0,
)
"""Of a depth image, and nothing against it."""


def test_the_covariance_is_as_large_as_errors_are(prepared_nose, trials) -> None:
    """By depth, points and several views apart; and what is kept is multiplied with it."""
    one = trials[0]
    views = [trial.observation("b") for trial in trials[:2]]
    apart = one.anatomy_T_camera.inverse() @ trials[1].anatomy_T_camera
    several_poses = np.stack([np.eye(4), apart.matrix])
    several = together(views, Pose(several_poses, CAMERA, CAMERA))
    clouds = together([trial.observation("d") for trial in trials[:2]], Pose(several_poses, CAMERA, CAMERA))
    every = (views[0], several, one.observation("d"), clouds)
    factors = [confidence.covariance_factor(seen) for seen in every]
    told = confidence._file()["covariance"]
    assert factors == [told[seen] for seen in ("depth", "several", "points", "points_several")]
    assert factors[1] > factors[0] > factors[2] > 1
    found = register(prepared_nose, views[0], NOTHING, RegisterConfig(seed=0))
    by_equations = fine(prepared_nose, views[0], Starts(found.best.matrix[None].copy(), np.zeros(1)))
    inverse = np.linalg.inv(by_equations.matrices[0])[:6, :6]
    assert np.diag(found.covariance) / np.diag(inverse) == pytest.approx(np.full(6, factors[0]), rel=0.2)


def test_what_fits_nothing_has_a_probability_and_more_surprise_never_helps() -> None:
    nothing = replace(
        GOOD, margin=0.0, rough_margin=0.0, explained=0.0, misfit=np.inf, spread=np.inf, excess=3.0, agreement=1.0,
        scatter=0.0, astray=0.0, dents=0.0, cloud=True,
    )  # fmt: skip
    assert max(probability(nothing), probability(replace(nothing, cloud=False))) <= 0.02
    fits = replace(nothing, margin=40.0, rough_margin=30.0, misfit=1.0, spread=1.0, explained=0.93, excess=0.7)
    by_surprise = [probability(replace(fits, surprise=float(z))) for z in (0, 3, 10, 30, 60, 200)]
    assert by_surprise[0] > 0.5
    assert (np.diff(by_surprise) < 0).all()
    by_ripples = [probability(replace(fits, ripples=r, waves=r)) for r in (1.0, 2.0, 4.0, 8.0)]
    assert (np.diff(by_ripples) < 0).all()
    assert probability(replace(fits, through=0.3)) < by_surprise[0]
    assert np.isfinite([features(replace(fits, views=3, again=again)) for again in (True, False)]).all()


def test_few_points_are_believed_less() -> None:
    cloud = replace(GOOD, cloud=True, sd_mm=0.6, sd_deg=1.5, within=0.95)
    told = [probability(replace(cloud, few=float(few))) for few in np.log([1.0, 2.0, 4.0, 8.0])]
    assert told[0] > 0.9
    assert (np.diff(told) < 0).all()


def test_depth_without_a_smooth_error_shares_nothing_with_its_neighbours() -> None:
    """What is said to be off pixel by pixel and is off together are other walls, but for far less than was said."""
    plain = replace(GOOD, plain=True)
    told = [probability(replace(plain, kinship=kinship)) for kinship in (0.0, 0.2, 0.4, 0.6, 0.8)]
    assert told[0] == probability(GOOD) > 0.8 and told[-1] < 0.01
    assert (np.diff(told) < 0).all()
    assert probability(replace(plain, kinship=0.8, spread=0.1)) > 0.7
    assert probability(replace(GOOD, kinship=0.8)) > 0.6  # as smooth errors are


def test_that_neighbours_share_nothing_makes_no_pose_surer() -> None:
    """Noise of its own hides what they share."""
    for doubtful in (replace(GOOD, margin=1.0), replace(GOOD, misfit=2.0), replace(GOOD, astray=6.0, again=True)):
        assert probability(replace(doubtful, plain=True, kinship=0.0)) <= probability(doubtful)


def test_exact_depth_of_another_patient_is_refused(prepared_nose, trials) -> None:
    other = registration_map(virtual_patient(77, 1))
    for trial in trials:
        assert register(prepared_nose, trial.observation("a")).status == "registered"
        assert register(other, trial.observation("a")).status == "refused"


def test_points_far_better_than_said_are_believed(prepared_nose, trials) -> None:
    """Who states 0.5 mm of a cloud that is exact, or nearly, gets the pose; of another patient's nose none is told."""
    other = registration_map(virtual_patient(77, 1))
    for sd_mm, some in ((0.0, trials[:3]), (0.15, trials[3:])):
        told = []
        for number, trial in enumerate(some):
            rng = np.random.default_rng(number)
            points = (trial.rays * trial.ranges["a"][..., None])[::3, ::3].reshape(-1, 3)
            points = points[np.isfinite(points).all(axis=1)]
            points += sd_mm * rng.standard_normal(points.shape)
            seen = from_points(points, PointNoise(0.5))
            found = register(prepared_nose, seen, config=RegisterConfig(seed=number))
            off_mm, off_rad = distance(found.best, trial.anatomy_T_camera)
            if off_mm < 2.0 and np.rad2deg(off_rad) < 5.0:
                told.append(found.status == "registered")
            assert register(other, seen, config=RegisterConfig(seed=number)).status == "refused"
        assert np.mean(told) > 0.7


def test_reasons_name_what_is_wrong() -> None:
    assert refusal(GOOD, 0.95, 0.8) is None
    assert "another patient" in (refusal(replace(GOOD, explained=0.3), 0.9, 0.8) or "")
    assert "several poses" in (refusal(replace(GOOD, margin=1.0), 0.4, 0.8) or "")
    assert "loose" in (refusal(replace(GOOD, sd_mm=2.5, sd_deg=9.0), 0.4, 0.8) or "")
