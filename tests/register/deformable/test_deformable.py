"""Shape and pose together: what is exact stays exact, what is not seen stays as it was, and doubt is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.gaussian_process import Deformation, GaussianProcess
from naris.anatomy.shape_model import ShapeModel
from naris.anatomy.triangles import index_triangles
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose, distance
from naris.errors import InputError
from naris.register.deformable.modes import Modes, of_gaussian_process, of_shape_model
from naris.register.deformable.posterior import Problem, Residuals, State, ended, residuals
from naris.register.deformable.register import refine, register_deformable
from naris.register.deformable.result import Limits, refusal
from naris.register.deformable.walls import Walls
from naris.register.map import registration_map
from naris.register.noise import KNOWN, UNKNOWN, DepthNoise, PointNoise, Scale
from naris.register.observation import Observation, from_depth, from_points, from_sightings
from naris.register.rays import memory_for, prepared
from naris.register.register import register
from naris.register.starts import Starts
from naris.render.scene import Scene, render
from tests.winding_tube import winding_tube

CLEAN = DepthNoise(smooth=0.0, pixel_mm=0.02, outliers=0.01)
EYE = Intrinsics.from_vertical_fov(40, 40, 80.0)
MODES = 6


@pytest.fixture(scope="module")
def tube():
    return winding_tube()


@pytest.fixture(scope="module")
def process(tube):
    return GaussianProcess.around(tube, Deformation(amplitude_mm=0.8, scale_mm=12.0))


@pytest.fixture(scope="module")
def modes(process):
    return of_gaussian_process(process, MODES)


@pytest.fixture(scope="module")
def at(tube):
    return registration_map(tube)


@pytest.fixture(scope="module")
def pose(tube):
    """A third of the way along, ahead and a little up: the bend and its walls are in view."""
    line = tube.passages[0].points_mm
    k = len(line) // 3
    return Pose.look(line[k], line[k + 8] - line[k] + [0.6, 0, 0.4], np.array([0.0, 0, 1]), tube.frame)


@pytest.fixture(scope="module")
def weights():
    return np.array([0.5, -0.4, 0.3, 0.4, -0.3, 0.2])


@pytest.fixture(scope="module")
def depth_mm(modes, weights, pose):
    """What a camera sees in the deformed tube."""
    return render(Scene(deformed(modes, weights)), pose, EYE, want=("depth",)).depth_mm[0].astype(np.float64)


def deformed(modes: Modes, weights: np.ndarray):
    return modes.mean.with_(vertices_mm=modes.vertices_mm(weights))


def beside(pose: Pose, log_scale: float = 0.0) -> Starts:
    moved = pose @ Pose.exp(np.array([0.4, -0.3, 0.5, 0.03, -0.04, 0.02]), CAMERA, CAMERA)
    return Starts(moved.matrix[None], np.array([log_scale]))


def points_of(depth_mm: np.ndarray) -> np.ndarray:
    rays = EYE.rays()
    return (rays / rays[..., 2:] * depth_mm[..., None]).reshape(-1, 3)[depth_mm.ravel() > 0]


def off_in_camera(found, modes: Modes, weights: np.ndarray, pose: Pose, depth_mm: np.ndarray) -> float:
    """The mean distance of the vertices in view from where they truly are, in the camera."""
    truth = pose.inverse().apply(modes.vertices_mm(weights))
    guess = found.best.inverse().apply(found.deformed.vertices_mm)
    from scipy.spatial import cKDTree

    seen = np.unique(cKDTree(truth).query(points_of(depth_mm))[1])
    return float(np.linalg.norm(guess - truth, axis=1)[seen].mean())


def test_modes_are_those_of_the_process_the_greatest_first(process, modes):
    every = of_gaussian_process(process, 10_000)
    assert len(every) == process.basis[0].shape[1] + 2 * process.basis[1].shape[1]
    size = np.square(every.by_vertex_mm).sum(axis=(0, 1))
    assert (np.diff(size) <= 1e-3 * size[0]).all()
    assert np.array_equal(every.first(MODES).by_vertex_mm, modes.by_vertex_mm)
    # All of them together have the deviation that the process was asked for.
    total = np.square(every.by_vertex_mm).sum(axis=2).mean()
    assert np.sqrt(total) == pytest.approx(process.deformation.amplitude_mm, rel=0.1)


def test_a_shape_model_and_its_modes_make_the_same_shapes(tube, modes, weights):
    stacked = np.ascontiguousarray(modes.by_vertex_mm.transpose(2, 0, 1))
    model = ShapeModel(tube, stacked, np.full(MODES, 1 / MODES), 7, 0.1)
    assert np.allclose(of_shape_model(model).vertices_mm(weights), model.vertices_mm(weights), atol=1e-5)
    assert len(of_shape_model(model, 2)) == 2


@pytest.mark.parametrize("kind", ["ranges", "points", "unknown"])
def test_the_rows_are_the_derivatives_of_the_residuals(at, modes, weights, pose, depth_mm, kind):
    seen = {
        "ranges": lambda: from_depth(depth_mm, EYE, DepthNoise(0.05, 9.3, 0.3)),
        "points": lambda: from_points(points_of(depth_mm)[::3], PointNoise(0.5)),
        "unknown": lambda: from_points(points_of(depth_mm)[::3] / 2, PointNoise(0.3), UNKNOWN),
    }[kind]()
    problem = problem_of(at, modes, seen)
    log_scale = float(np.log(2.1)) if kind == "unknown" else 0.0
    state = State(beside(pose).poses[0], log_scale, np.zeros(problem.model.smooth), 0.5 * weights)
    here, real = of_rays(problem, state), problem.rays.valid != 0
    for k in range(problem.unknowns):
        step = np.zeros(problem.unknowns)
        step[k] = 1e-3
        slope = (of_rays(problem, state, step).error - of_rays(problem, state, -step).error) / 2e-3
        off = np.abs(slope - here.rows[:, k])[real]
        # A ray that slips to the next face has another slope there.
        size = np.abs(here.rows[real, k]).max()
        assert np.mean(off < 0.01 * size + 2e-3) > 0.9


def problem_of(at, modes: Modes, seen: Observation) -> Problem:
    ready = prepared(at, seen, fine=True, lattice=False)
    mean = modes.mean
    walls = Walls(mean.vertices_mm, mean.faces, at.inside)
    return Problem(modes, ready.rays, ready.model, memory_for(ready.rays), mean.faces, walls)


def of_rays(problem: Problem, state: State, step: np.ndarray | None = None) -> Residuals:
    if step is not None:
        free, first = problem.model.free, problem.first_weight
        moved = state.pose @ Pose.exp(step[:6], "", "").matrix
        scale = state.log_scale + (float(step[6]) if free else 0.0)
        state = State(moved, scale, state.smooth + step[6 + free : first], state.weights + step[first:])
    return residuals(problem, state, *ended(problem, state))


def test_without_noise_a_small_shape_is_found_exactly(at, modes, weights, pose, depth_mm):
    """The walls are, in view; where on a smooth wall a vertex went, one view cannot tell, and says so."""
    found = refine(at, modes, from_depth(depth_mm, EYE, CLEAN), beside(pose), steps=60)
    assert found.converged
    assert found.fit.explained > 0.97 and found.fit.p95_mm < 0.02
    walls = index_triangles(found.deformed.vertices_mm, found.deformed.faces)
    assert walls.closest(found.best.apply(points_of(depth_mm))).distance_mm.mean() < 0.01
    assert (np.abs(found.weights - weights) < 3 * found.weight_sd).all()
    rigid = refine(at, modes.first(0), from_depth(depth_mm, EYE, CLEAN), beside(pose), steps=60)
    off = [off_in_camera(one, modes, weights, pose, depth_mm) for one in (found, rigid)]
    assert off[0] < 0.2 < 0.6 < off[1]


def test_seen_from_one_end_to_the_other_weights_are_found(at, modes, weights):
    truth = deformed(modes, weights)
    line, points, cameras = truth.passages[0].points_mm, [], []
    for k in range(20, len(line) - 12, 20):
        eye = Pose.look(line[k], line[k + 8] - line[k], np.array([0.0, 0, 1]), truth.frame)
        depth = render(Scene(truth), eye, EYE, want=("depth",)).depth_mm[0].astype(np.float64)
        cameras.append(eye)
        points.append(eye.apply(points_of(depth)[::20]))
    first = cameras[0].inverse()
    seen_from = np.repeat(np.arange(len(points)), [len(some) for some in points])
    places = np.stack([first.apply(eye.position_mm) for eye in cameras])
    seen = from_sightings(first.apply(np.concatenate(points)), places, seen_from, PointNoise(0.05))
    start = cameras[0] @ Pose.exp(np.array([0.4, -0.3, 0.5, 0.01, -0.02, 0.02]), CAMERA, CAMERA)
    found = refine(at, modes, seen, Starts(start.matrix[None], np.zeros(1)), steps=60)
    off_mm, off_rad = distance(found.best, cameras[0])
    assert off_mm < 0.2 and np.rad2deg(off_rad) < 0.2
    told = found.weight_sd < 0.13
    assert told.sum() >= 4
    assert np.abs(found.weights - weights)[told].max() < 0.05


def test_points_find_it_too_and_outliers_do_not_draw_it_away(at, modes, weights, pose, depth_mm):
    rng = np.random.default_rng(3)
    points = points_of(depth_mm)[::2]
    clean = refine(at, modes, from_points(points, PointNoise(0.05)), beside(pose), steps=60)
    assert off_in_camera(clean, modes, weights, pose, depth_mm) < 0.1
    wrong = rng.random(len(points)) < 0.2
    points = np.where(wrong[:, None], points * rng.uniform(0.3, 3.0, (len(points), 1)), points)
    found = refine(at, modes, from_points(points, PointNoise(0.05, outliers=0.2)), beside(pose), steps=60)
    assert off_in_camera(found, modes, weights, pose, depth_mm) < 0.1
    assert found.fit.explained < 0.95


def test_a_known_scale_is_kept_an_unknown_one_found_and_a_prior_counts(at, modes, pose, weights, depth_mm):
    half = depth_mm / 2
    known = refine(at, modes, from_depth(depth_mm, EYE, CLEAN, KNOWN), beside(pose), steps=60)
    assert known.scale == 1.0 and known.scale_sd == 0.0
    unknown = refine(at, modes, from_depth(half, EYE, CLEAN, UNKNOWN), beside(pose, np.log(1.8)), steps=60)
    assert unknown.scale == pytest.approx(2.0, abs=3 * 2.0 * unknown.scale_sd + 0.02)
    assert unknown.scale_sd > 0
    sure = Scale("prior", 2.0, 1e-4)
    held = refine(at, modes, from_depth(half, EYE, CLEAN, sure), beside(pose, np.log(2.0)), steps=60)
    assert held.scale == pytest.approx(2.0, abs=2e-3)
    assert held.scale_sd < unknown.scale_sd


def test_a_scale_that_ends_at_its_limit_is_no_answer(at, modes, pose, depth_mm):
    sought = Scale("unknown", low=1.5, high=1.98)
    found = refine(at, modes, from_depth(depth_mm / 2, EYE, CLEAN, sought), beside(pose, np.log(1.9)), steps=60)
    assert found.scale > 1.96
    assert found.status == "refused" and found.anatomy_T_camera is None
    assert "limit of what was sought, 1.5 to 1.98 mm a unit" in found.reason


def test_few_vague_points_leave_the_shape_at_its_prior(at, modes, pose, depth_mm):
    few = points_of(depth_mm)[:: len(points_of(depth_mm)) // 15]
    found = refine(at, modes, from_points(few, PointNoise(4.0)), beside(pose))
    assert np.abs(found.weights).max() < 0.15
    assert found.weight_sd.min() > 0.9 and found.weight_sd.max() <= 1 + 1e-6
    assert found.status == "refused"


def test_what_is_in_view_is_told_and_what_is_not_stays_loose(at, process, pose, depth_mm):
    modes = of_gaussian_process(process, 60)
    found = refine(at, modes, from_depth(depth_mm, EYE, DepthNoise(0.02, 9.3, 0.2)), beside(pose))
    before = np.linalg.norm(modes.by_vertex_mm, axis=(1, 2))
    share = found.vertex_sd_mm / before
    behind = pose.inverse().apply(modes.mean.vertices_mm)[:, 2] < -30
    ahead = pose.inverse().apply(modes.mean.vertices_mm)[:, 2]
    assert np.median(share[behind]) > 0.9
    assert np.median(share[(ahead > 10) & (ahead < 20)]) < 0.85
    assert found.target_sd_mm < np.median(before)


@pytest.mark.parametrize("noise", ["b", "c", pytest.param("d", marks=pytest.mark.long)])
def test_without_modes_it_is_rigid_registration(nose, prepared_nose, trials, noise):
    seen = trials[0].observation(noise)
    none = Modes(nose, np.zeros((len(nose.vertices_mm), 3, 0), np.float32))
    found, rigid = register_deformable(prepared_nose, none, seen), register(prepared_nose, seen)
    off_mm, off_rad = distance(found.best, rigid.best)
    # Points belong to the nearest wall there and to all that is seen around them here: apart as far as they are unsure.
    # Of ranges the equations are the same, but from other starts one may rest in a neighbouring dent of the costs.
    sd_mm, sd_rad = (
        np.sqrt(np.linalg.eigvalsh(block)[-1]) for block in (rigid.covariance[:3, :3], rigid.covariance[3:, 3:])
    )
    assert off_mm < (3 * sd_mm if noise == "d" else 0.1)
    assert off_rad < (3 * sd_rad if noise == "d" else np.deg2rad(0.6))
    assert found.scale == pytest.approx(rigid.scale, rel=0.01)
    assert found.deformed is nose and found.weights.shape == (0,)
    assert found.status == "refused" and found.anatomy_T_camera is None


def test_regions_landmarks_and_passages_come_along(at, modes, weights, pose, depth_mm):
    found = refine(at, modes, from_depth(depth_mm, EYE, CLEAN), beside(pose), steps=60)
    mean, there = modes.mean, found.deformed
    assert there.passages[0].name == "main" and there.frame == mean.frame
    # A point in the middle of a slab has the region that it came from, wherever it went.
    line = mean.passages[0].points_mm
    for y in (-30.0, -10.0, 10.0, 30.0):
        k = int(np.argmin(np.abs(line[:, 1] - y)))
        moved, slabs = there.passages[0].points_mm[k], mean.region_set("slabs")
        assert there.region_set("slabs").label(moved) == slabs.label(line[k])


def test_the_search_finds_its_place_or_says_that_it_cannot(at, modes, weights, pose, depth_mm):
    found = register_deformable(at, modes, from_depth(depth_mm, EYE, DepthNoise(0.02, 9.3, 0.1)))
    right = off_in_camera(found, modes, weights, pose, depth_mm) < 2.0
    assert right or found.status == "refused"
    assert (found.anatomy_T_camera is None) == (found.reason is not None) == (found.status == "refused")
    again = register_deformable(at, modes, from_depth(depth_mm, EYE, DepthNoise(0.02, 9.3, 0.1)))
    assert np.array_equal(found.best.matrix, again.best.matrix) and np.array_equal(found.weights, again.weights)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"explained": 0.5}, "no shape of the model explains"),
        ({"misfit": 2.0}, "times as far off"),
        ({"converged": False}, "come to rest"),
        ({"weights": np.eye(MODES)[0] * 3.5}, "hardly one of the model's patients"),
        ({"stretch": 4.0}, "hardly one of the model's patients"),
        ({"margin": 3.0}, "several places fit alike"),
        ({"target_sd_mm": 0.6}, "loose"),
        ({"turn_sd_deg": 1.5}, "loose"),
    ],
)
def test_every_limit_refuses_with_its_reason(at, modes, pose, depth_mm, change, message):
    good = refine(at, modes, from_depth(depth_mm, EYE, CLEAN), beside(pose), steps=60)
    good = replace(
        good, converged=True, margin=50.0, target_sd_mm=0.1, turn_sd_deg=0.5, weights=np.zeros(MODES), stretch=1.0,
        fit=replace(good.fit, explained=0.95, misfit=1.0),
    )  # fmt: skip
    assert refusal(good) is None
    of_fit = {key: value for key, value in change.items() if hasattr(good.fit, key)}
    others = {key: value for key, value in change.items() if key not in of_fit}
    assert message in refusal(replace(good, fit=replace(good.fit, **of_fit), **others))
    if "converged" not in change:
        assert refusal(replace(good, fit=replace(good.fit, **of_fit), **others), ANYTHING) is None


ANYTHING = Limits(0.0, np.inf, -np.inf, np.inf, np.inf, np.inf, np.inf)


def test_modes_of_another_anatomy_are_refused(at, nose):
    none = Modes(nose, np.zeros((len(nose.vertices_mm), 3, 0), np.float32))
    seen = from_points(np.random.default_rng(0).uniform(1, 5, (30, 3)))
    with pytest.raises(InputError, match="modes of the anatomy that was prepared"):
        register_deformable(at, none, seen)
