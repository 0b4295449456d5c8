"""Shapes beside rigid registration: what is judged, what is cut in half, and what is missing where nothing is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.bench import BenchRequest, deformable
from naris.bench.deformable import BASE, SFM, SHOT, Patient, halves, judged, observed_shot
from naris.bench.trials import MEAN, drawn_trials
from naris.core.pose import CAMERA, Pose
from naris.register.deformable.modes import Modes
from naris.register.deformable.register import refine
from naris.register.map import registration_map
from naris.register.observation import from_sightings
from naris.register.starts import Starts
from tests.conftest import SHARED_DATA, shared_file
from tests.winding_tube import winding_tube


@pytest.mark.parametrize("request_", [BenchRequest(), BenchRequest(quick=True, scans=SHARED_DATA)])
def test_without_the_mean_nose_or_the_time_there_are_no_values(request_: BenchRequest) -> None:
    told = deformable.figures(request_)
    names = {one.name for one in told}
    assert {f"{BASE}.b.modes.target_mm", f"{BASE}.d.rigid.pose_mm", f"{BASE}.false_accept"} <= names
    assert {f"{SFM}.{name}" for name in ("residual_mm", "halves_mm", "halves_deg", "halves_scale")} <= names
    assert all(one.value is None and one.n == 0 for one in told)
    assert len(names) == len(told)


def test_the_truth_is_no_way_off_and_a_move_is_as_far_as_it_is() -> None:
    tube = winding_tube()
    (trial,) = drawn_trials(tube, 1, 3)
    modes = Modes(tube, (0.3 * tube.vertex_normals).astype(np.float32)[..., None])
    start = Starts(trial.anatomy_T_camera.matrix[None], np.zeros(1))
    found = refine(registration_map(tube), modes, trial.observation("a"), start)
    truth = Patient(tube, np.zeros(1), [trial])
    right = judged(truth, trial, "a", replace(found, best=trial.anatomy_T_camera, deformed=tube, weights=np.zeros(1)))
    assert right.target_mm < 1e-6 and right.surface_mm < 1e-3 and right.off_mm < 1e-6
    assert right.score == 0.0 and right.right
    moved = trial.anatomy_T_camera @ Pose.exp(np.array([3.0, 0, 0, 0, 0, 0]), CAMERA, CAMERA)
    wrong = judged(truth, trial, "a", replace(found, best=moved, deformed=tube))
    assert wrong.target_mm == pytest.approx(3.0) and wrong.off_mm == pytest.approx(3.0)
    assert wrong.turn_deg < 1e-3 and not wrong.right


def test_halves_share_no_point_and_leave_none_out() -> None:
    rng = np.random.default_rng(1)
    points, seen_from = rng.uniform(1, 9, (201, 3)), np.sort(rng.integers(3, size=201))
    seen = from_sightings(points, rng.uniform(-1, 0, (3, 3)), seen_from)
    one, other = halves(seen, np.random.default_rng(0))
    assert abs(len(one) - len(other)) <= seen.views and len(one) + len(other) == len(seen)
    assert one.views == other.views == seen.views
    both = np.concatenate([one.directions, other.directions])
    assert len(np.unique(both, axis=0)) == len(seen)


def test_the_real_shot_is_seen_from_the_camera_of_a_frame() -> None:
    seen = observed_shot(shared_file(SHOT))
    assert seen.scale.kind == "unknown" and seen.views > 1 and len(seen) > 500
    assert np.abs(seen.origins[seen.view == 0]).max() < 1e-9


@pytest.mark.long
def test_a_quick_run_measures_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    shared_file(MEAN), shared_file(f"{SHOT}/motion.yaml")
    monkeypatch.setattr(deformable, "VIEWS", 1)
    monkeypatch.setattr(deformable, "SETS", {"": ("b",)})
    told = {one.name: one for one in deformable.figures(BenchRequest(True, scans=SHARED_DATA, only="deformable"))}
    assert told[f"{BASE}.b.modes.target_mm"].n == 1
    assert (told[f"{BASE}.b.modes.target_mm"].value or 9) < (told[f"{BASE}.b.rigid.target_mm"].value or 0)
    assert told[f"{SFM}.halves_scale"].n == 1 and (told[f"{SFM}.halves_scale"].value or 0) >= 1
