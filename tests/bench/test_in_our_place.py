"""Solvers in our place: they get our starts, in mm, and our likelihood chooses among what they make of them."""

from __future__ import annotations

import numpy as np
import pytest

from naris.bench import in_our_place
from naris.bench.in_our_place import OURS, STARTS, solver_of
from naris.bench.problems import problem
from naris.bench.trials import Noise, Trial
from naris.core.pose import distance
from naris.register.map import RegistrationMap
from naris.register.register import FROM_POSE
from naris.register.starts import near


@pytest.mark.parametrize("noise", ["b", "c", "d", "e"])
def test_a_library_gets_points_in_mm_and_each_start_once(
    noise: Noise, tube: RegistrationMap, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that leaves every start where it is, so the likeliest start is what comes out."""
    clouds, aligned = [], []

    def of_cloud(points: np.ndarray):
        clouds.append(points)

        def align(pose: np.ndarray) -> np.ndarray:
            aligned.append(pose)
            return pose

        return align

    monkeypatch.setattr(in_our_place, "missing", lambda name: None)
    monkeypatch.setattr(in_our_place, "library_for", lambda *_: of_cloud)
    seen, truth = trial.observation(noise), trial.anatomy_T_camera
    belief = near(truth.reshape(1), np.diag([0.3**2] * 3 + [0.05**2] * 3)[None])
    solver = solver_of("small_gicp", tube.anatomy)
    assert not isinstance(solver, str)
    answer = solver(tube, seen, belief)
    found = answer.pose
    assert answer.judging_s > 0
    assert len(aligned) == STARTS
    np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)
    nearest = min(np.abs(pose[:3] - found.matrix[:3]).max() for pose in aligned)
    assert nearest < 1e-3
    off_mm, off_rad = distance(found, truth)
    assert off_mm < 1.0
    assert off_rad < 0.1
    mm = np.median(
        np.linalg.norm(trial.observation("d" if noise in "de" else "b").directions * seen.ranges[:, None], axis=1)
    )
    mm *= float(np.exp(trial.log_scale(noise)))
    sizes = [np.median(np.linalg.norm(points, axis=1)) for points in clouds]
    assert np.median(sizes) == pytest.approx(mm, rel=0.15)
    if not seen.scale.free:
        assert len(clouds) == 1


def test_of_fewer_starts_and_of_several_views_a_library_gets_all(
    tube: RegistrationMap, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    clouds, aligned = [], []

    def of_cloud(points: np.ndarray):
        clouds.append(points)
        return lambda pose: aligned.append(pose) or pose

    monkeypatch.setattr(in_our_place, "missing", lambda name: None)
    monkeypatch.setattr(in_our_place, "library_for", lambda *_: of_cloud)
    solver = solver_of("small_gicp", tube.anatomy, config=FROM_POSE)
    assert not isinstance(solver, str)
    look, belief, _ = problem(tube, trial, "b", "pose", 0)
    solver(tube, look(), belief)
    assert len(aligned) == FROM_POSE.starts
    of_all = solver_of("small_gicp", tube.anatomy)
    assert not isinstance(of_all, str)
    look, belief, _ = problem(tube, trial, "c", "views3", 0)
    clouds.clear()
    of_all(tube, look(), belief)
    assert {len(points) for points in clouds} == {len(look())}
    # In mm: cameras of a scale that is not known are as far apart as what they see.
    apart = [np.ptp(points, axis=0).max() for points in clouds]
    across = np.ptp(look().origins + look().ranges[:, None] * look().directions, axis=0).max()
    ratio = np.median(apart) / across
    assert ratio == pytest.approx(1 / trial.scale, rel=0.3)


def test_ours_ends_at_the_truth(tube: RegistrationMap, trial: Trial) -> None:
    solver, truth = solver_of(OURS, tube.anatomy), trial.anatomy_T_camera
    assert not isinstance(solver, str)
    found = solver(tube, trial.observation("a"), near(truth.reshape(1), np.diag([0.3**2] * 3 + [0.05**2] * 3)[None]))
    # Along a tube and around it a view is loose; what is seen lies where it is.
    assert distance(found.pose, truth)[0] < 1.0
    assert found.judging_s == 0
