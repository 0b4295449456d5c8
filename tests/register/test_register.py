"""From what was seen to a pose: right where it can be, refused where it cannot, and the same for every scale."""

import numpy as np
import pytest

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.trials import drawn_trials, neighbours_of
from naris.core.pose import CAMERA, Pose, distance
from naris.core.results import Prediction
from naris.errors import InputError, PoseError, RegionError, SurfaceError
from naris.register.map import registration_map
from naris.register.noise import DepthNoise, PointNoise, Scale
from naris.register.observation import from_points, from_ranges, together
from naris.register.rays import prepared
from naris.register.register import RegisterConfig, register
from naris.register.starts import NOTHING, Belief, Orientation, in_region, near, of_prediction

QUICK = RegisterConfig(starts=80, finalists=6)


def off(found, trial):
    mm, rad = distance(found.best, trial.anatomy_T_camera)
    return float(mm), float(np.rad2deg(rad))


def test_clean_views_from_nothing_end_at_the_truth(prepared_nose, trials):
    for trial in trials:
        found = register(prepared_nose, trial.observation("a"))
        assert off(found, trial) < (0.05, 0.5)
        assert (found.reason is None) == (found.anatomy_T_camera is not None)


@pytest.mark.parametrize("noise", ["b", "c", "d"])
def test_noisy_views_end_near_the_truth_or_are_doubted(nose, prepared_nose, trials, noise):
    regions, right = nose.region_set(), 0
    for trial in trials:
        name = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
        found = register(prepared_nose, trial.observation(noise), in_region(regions, name), QUICK)
        good = off(found, trial)[0] <= 2.0 and off(found, trial)[1] <= 5.0
        right += good
        assert good or found.probability < 0.9
    assert right >= len(trials) - 2


def test_the_scale_is_found_where_it_is_unknown(prepared_nose, trials):
    trial = trials[0]
    for factor in (0.6, 1.0, 1.7):
        ranges = trial.ranges["a"] / factor
        seen = from_ranges(ranges, trial.rays, DepthNoise(smooth=0.0, pixel_mm=0.05), Scale("unknown"))
        found = register(prepared_nose, seen)
        assert found.scale == pytest.approx(factor, rel=0.02)
        assert off(found, trial) < (0.2, 1.0)


def test_a_prior_of_the_scale_draws_it(prepared_nose, trials):
    trial = trials[0]
    seen = from_ranges(trial.ranges["b"] / 1.2, trial.rays, DepthNoise(), Scale("prior", 1.2, 0.05))
    found = register(prepared_nose, seen, NOTHING, QUICK)
    assert found.scale == pytest.approx(1.2, rel=0.08)


def test_of_a_known_scale_nothing_is_freed(prepared_nose, trials):
    assert register(prepared_nose, trials[0].observation("b"), NOTHING, QUICK).scale == 1.0


def test_from_a_believed_pose_it_ends_there_and_looks_nowhere_else(prepared_nose, trials):
    trial = trials[2]
    moved = trial.anatomy_T_camera @ Pose.exp(np.array([0.8, -0.5, 0.4, 0.05, 0.08, -0.06]), CAMERA, CAMERA)
    spread = np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])[None]
    found = register(prepared_nose, trial.observation("a"), near(moved, spread), RegisterConfig(8, 2))
    assert off(found, trial) < (0.05, 0.5)


def test_a_prediction_of_the_wrong_region_does_not_hide_the_right_one(nose, prepared_nose, trials):
    """Probabilities are softened: a sure mistake costs evidence, not the answer."""
    regions, trial = nose.region_set(), trials[0]
    label = int(regions.label(trial.anatomy_T_camera.position_mm))
    wrong = np.full(len(regions.names), 1e-6)
    wrong[(label + 1) % len(wrong)] = 1.0
    said = Prediction(regions.name, tuple(regions.names), np.log(wrong / wrong.sum()))
    found = register(prepared_nose, trial.observation("a"), of_prediction(said, regions))
    assert off(found, trial) < (0.1, 0.5)


def test_three_views_are_better_than_one(nose, prepared_nose, trials):
    views, rig_T_camera = neighbours_of(nose, trials[3], 2, 5)
    found = register(prepared_nose, together([one.observation("b") for one in views], rig_T_camera), NOTHING, QUICK)
    assert off(found, trials[3]) < (1.0, 3.0)


def test_another_patient_and_a_mirrored_side_are_refused(nose, prepared_nose, trials):
    stranger = virtual_patient(77, 1)
    others = drawn_trials(stranger, 4, 3)
    seen = [one.observation("b") for one in others]
    mirrored = [from_ranges(one.ranges["b"][:, ::-1], one.rays, DepthNoise()) for one in trials[:3]]
    results = [register(prepared_nose, one) for one in [*seen, *mirrored]]
    refused = [one.status == "refused" for one in results]
    assert np.mean(refused) >= 0.8
    assert all(one.anatomy_T_camera is None and one.reason for one in results if one.status == "refused")


def test_the_same_question_has_the_same_answer(prepared_nose, trials):
    one, other = (register(prepared_nose, trials[4].observation("b"), NOTHING, QUICK) for _ in range(2))
    np.testing.assert_array_equal(one.best.matrix, other.best.matrix)
    assert one.probability == other.probability


def test_the_covariance_is_that_of_the_camera(prepared_nose, trials):
    found = register(prepared_nose, trials[0].observation("b"), NOTHING, QUICK)
    assert np.allclose(found.covariance, found.covariance.T)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    assert np.sqrt(np.diag(found.covariance)[:3]).max() < 2.0


def test_beliefs_of_another_frame_or_region_are_refused(nose, prepared_nose, trials):
    regions, seen = nose.region_set(), trials[0].observation("b")
    with pytest.raises(RegionError, match="one of the regions"):
        in_region(regions, "liver")
    with pytest.raises(RegionError, match="use a model made for"):
        of_prediction(Prediction("x", ("a", "b"), np.log([0.5, 0.5])), regions)
    with pytest.raises(PoseError, match="into the frame LPS"):
        register(prepared_nose, seen, near(Pose(np.eye(4), "mean", CAMERA), np.eye(6)[None]), QUICK)
    with pytest.raises(RegionError, match="room for a camera"):
        register(prepared_nose, seen, Belief(regions, {}), QUICK)


def test_an_anatomy_without_room_is_refused(nose):
    with pytest.raises(SurfaceError, match="room for a camera"):
        registration_map(nose.with_(vertices_mm=nose.vertices_mm / 40))


def test_orientations_that_cannot_be_are_refused():
    for wrong in ({"tilt_deg": 0.0}, {"roll_deg": 190.0}, {"apart_deg": 1.0}):
        with pytest.raises(InputError, match="tilt and a roll"):
            Orientation(**wrong)


@pytest.mark.parametrize("least", [80.0, -0.1, float("nan")])
def test_a_threshold_that_is_no_probability_is_refused(least) -> None:
    with pytest.raises(InputError, match="a probability from 0 to 1"):
        RegisterConfig(least_probability=least)


def test_a_scale_that_ends_at_its_limit_is_no_answer(prepared_nose, trials):
    """The truth lies a little beyond what was sought, and poses that nearly fit are sure enough but for that."""
    limited = Scale("unknown", low=0.4, high=1.45)
    results = [
        register(prepared_nose, from_ranges(one.ranges["b"] / 1.5, one.rays, DepthNoise(pixel_mm=0.2), limited))
        for one in trials
    ]
    at_limit = [one for one in results if one.scale > 1.44]
    assert len(at_limit) >= 3
    assert max(one.probability for one in at_limit) > 0.8
    for one in at_limit:
        assert one.status == "refused"
        assert one.anatomy_T_camera is None
        assert "limit of what was sought, 0.4 to 1.45 mm a unit" in one.reason


def test_what_lies_further_away_than_the_anatomy_is_long_is_refused_before_any_search(prepared_nose, trials):
    with pytest.raises(InputError, match=r"fit into .* mm across, got a median of"):
        register(prepared_nose, from_ranges(50.0 * trials[0].ranges["a"], trials[0].rays))


def test_of_several_views_the_smooth_error_is_counted_whole(prepared_nose, trials):
    one = trials[0].observation("b")
    stands = Pose(np.tile(np.eye(4), (4, 1, 1)), CAMERA, CAMERA)
    several = prepared(prepared_nose, together([one] * 4, stands), fine=True)
    rays = several.rays
    real = rays.valid != 0
    said = (np.square(rays.field[:, : len(rays.prior)]) / rays.prior).sum(axis=1)[real]
    left = (np.square(rays.radial) - np.square(np.tile(one.radial, 4)))[real] / np.square(rays.range[real])
    np.testing.assert_allclose(said + left, one.smooth**2, rtol=0.02)


def test_with_less_tried_than_the_probability_knows_nothing_is_claimed(prepared_nose, trials):
    """A search that looks at one place finds no rival of it."""
    seen = trials[0].observation("b")
    whole, one = register(prepared_nose, seen), register(prepared_nose, seen, config=RegisterConfig(finalists=1))
    assert whole.status == "registered"
    assert one.status == "refused" and "less was tried than its probability was fitted with" in one.reason
    any_will_do = RegisterConfig(finalists=1, least_probability=0.0)
    assert register(prepared_nose, seen, config=any_will_do).status == "registered"
    there = near(trials[0].anatomy_T_camera, 1e-6 * np.eye(6)[None])
    assert register(prepared_nose, seen, there, RegisterConfig(8, 1, 0)).status == "registered"


def test_a_dense_cloud_is_believed_as_a_thinner_one(prepared_nose, trials):
    rng, right = np.random.default_rng(5), []
    for trial in (trials[0], trials[2], trials[5]):
        known = np.isfinite(trial.ranges["a"])
        points = (trial.rays * trial.ranges["a"][..., None])[known]
        thick = np.repeat(points, 6, axis=0) + 0.5 * rng.standard_normal((6 * len(points), 3))
        thick = thick[thick[:, 2] > 0]
        assert len(thick) > 10_000
        found = register(prepared_nose, from_points(thick, PointNoise(0.5, 0.02)))
        assert off(found, trial)[0] < 1.0
        right.append(found.probability)
    assert np.median(right) > 0.9
