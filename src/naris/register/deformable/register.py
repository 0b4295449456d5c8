"""From an observation and a mean anatomy with modes to a pose, a scale and a shape.

The rigid search on the mean gives the starts; from the best of them pose, scale, smooth error and weights of the modes
are solved together, and the basin that holds most of the posterior wins. Sources: A. Sinha, S. D. Billings, A. Reiter
et al., "The deformable most-likely-point paradigm", Medical Image Analysis 2019, whose matches and prior these are but
for the rays; M. Lüthi et al., "Gaussian process morphable models", 2018, for modes of one anatomy alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from naris.anatomy.carry import carried_along
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose
from naris.errors import InputError, PoseError
from naris.register.deformable.modes import Modes
from naris.register.deformable.posterior import Problem, State, ended, moves, residuals
from naris.register.deformable.result import DeformableRegistration, Fit, refusal
from naris.register.deformable.solve import Ended, descended
from naris.register.deformable.walls import Places, Walls
from naris.register.equations import POSE
from naris.register.map import RegistrationMap
from naris.register.noise import Scale
from naris.register.observation import Observation
from naris.register.rays import memory_for, prepared
from naris.register.register import at_limit
from naris.register.solve import Solutions, coarse, different
from naris.register.starts import NOTHING, Belief, Starts, find_starts

_BASIN_MM, _BASIN_RAD = 2.0, 0.15
_EXPLAINED_SD = 3.0
_LEAST_CHANCE = 1e-3
_RIGID = "without modes nothing says how far the patient differs from the mean: register judges such poses"
_EVERY = 8  # of the rays: walls move smoothly
_AROUND_MM, _AROUND = 10.0, 1.5  # of what a camera sees, and more than the 95th percentile of it


@dataclass(frozen=True)
class DeformableConfig:
    """How much is tried.

    Attributes:
        starts: solved coarsely, on the rigid mean.
        finalists: solved with the shape.
        steps: at most so many for each of them, at the noise that was said.
        seed: of the starts beside believed poses.
    """

    starts: int = 200
    finalists: int = 6
    steps: int = 40
    seed: int = 0


def register_deformable(
    at: RegistrationMap,
    modes: Modes,
    observation: Observation,
    belief: Belief = NOTHING,
    config: DeformableConfig = DeformableConfig(),
) -> DeformableRegistration:
    """Find the camera that saw this, the scale if it is not known, and the shape of the anatomy.

    In the search on the mean, how far walls differ from it counts as noise of every ray; from there on it is the shape.
    Without modes this is rigid registration by rays, and always refused: the limits are on shapes. A mode of which
    nothing was seen keeps weight 0 and deviation 1.

    Args:
        at: the mean, prepared (`registration_map`).
        modes: of the shape.
        observation: what was seen; of a cloud 1,024 points a view are used, evenly chosen.
        belief: what is known beforehand of region or pose, in the frame of the mean.
        config: how much is tried.

    Raises:
        InputError: if the map is of another anatomy than the modes.
        PoseError: if believed poses are in another frame.
        RegionError: if no believed region has room for a camera.
    """
    if at.anatomy.digest != modes.mean.digest:
        raise InputError("modes of the anatomy that was prepared", "those of another", "prepare the mean of the model")
    observation, rng = observation.used(), np.random.default_rng(config.seed)
    wide = _with_shape_as_noise(observation, modes.off_mm)
    rough = coarse(at, wide, find_starts(at, wide, belief, config.starts, rng))
    # Solved with the shape, neighbours end alike; what another place has to say is worth more.
    kept = different(rough, config.finalists, _BASIN_MM, _BASIN_RAD)
    return _best(at, modes, observation, Starts(rough.poses[kept], rough.log_scales[kept]), (belief, config.steps))


def refine(
    at: RegistrationMap, modes: Modes, observation: Observation, starts: Starts, steps: int = 40
) -> DeformableRegistration:
    """As `register_deformable`, from given starts and no others."""
    return _best(at, modes, observation, starts, (NOTHING, steps))


def _best(
    at: RegistrationMap, modes: Modes, observation: Observation, starts: Starts, how: tuple[Belief, int]
) -> DeformableRegistration:
    belief, steps = how
    seen = prepared(at, observation, fine=True, lattice=False)
    rays, model = seen.rays, seen.model
    begun = Problem(
        modes, rays, model, memory_for(rays), at.anatomy.faces,
        Walls(at.anatomy.vertices_mm, at.anatomy.faces, at.inside),
    )  # fmt: skip
    ends: list[tuple[Problem, Ended]] = []
    for pose, log_scale in zip(starts.poses, starts.log_scales, strict=True):
        state = State(pose, float(log_scale), np.zeros(model.smooth), np.zeros(len(modes)))
        problem = _around(begun, state)
        ends.append((problem, descended(problem, state, steps)))
    poses = np.stack([one.state.pose for _, one in ends])
    odds = np.array([one.evidence for _, one in ends])
    odds = odds - 2 * np.log(np.maximum(belief.chance(poses[:, :3, 3]), _LEAST_CHANCE))
    order = np.argsort(odds, kind="stable")
    scales = np.array([one.state.log_scale for _, one in ends])
    solutions = Solutions(poses[order], scales[order], odds[order], seen.count, model)
    basins = different(solutions, 2, _BASIN_MM, _BASIN_RAD)
    margin = float(odds[order[basins[1]]] - odds[order[0]]) if len(basins) > 1 else np.inf
    problem, end = ends[order[0]]
    return _told(problem, end, observation.scale, np.inf if np.isnan(margin) else margin)


def _with_shape_as_noise(observation: Observation, off_mm: float) -> Observation:
    """Walls that are off by so much, told as noise of every ray by itself."""
    if not off_mm:
        return observation
    off = off_mm / observation.scale.middle
    return replace(observation, isotropic=np.hypot(observation.isotropic, off))


def _around(problem: Problem, state: State) -> Problem:
    """The same with the faces alone that a camera near there can see: walls are built anew at each step."""
    if not len(problem.modes):
        return problem
    reach = _AROUND * float(np.percentile(problem.rays.range, 95)) * float(np.exp(state.log_scale)) + _AROUND_MM
    origins = np.exp(state.log_scale) * problem.rays.origin @ state.pose[:3, :3].T + state.pose[:3, 3]
    low, high = origins.min(axis=0) - reach, origins.max(axis=0) + reach
    near = ((problem.at_mean.vertices_mm > low) & (problem.at_mean.vertices_mm < high)).all(axis=1)
    faces = np.ascontiguousarray(problem.faces[near[problem.faces].any(axis=1)])
    if not len(faces):
        return problem
    return replace(problem, faces=faces, at_mean=Walls(problem.at_mean.vertices_mm, faces, problem.model.inside))


def _told(problem: Problem, end: Ended, scale: Scale, margin: float) -> DeformableRegistration:
    """The result, refused or not."""
    state, first, frame = end.state, problem.first_weight, problem.modes.mean.frame
    covariance = np.linalg.inv(end.at.matrix + 1e-9 * np.eye(problem.unknowns))
    walls, places = ended(problem, state)
    target_sd_mm, turn_sd_deg = _in_view(problem, state, walls, places, covariance)
    deformed, closed = _deformed(problem.modes, state.weights)
    pose = Pose(state.pose, frame, CAMERA)
    found = DeformableRegistration(
        anatomy_T_camera=None,
        best=pose,
        status="refused",
        reason=None,
        scale=float(np.exp(state.log_scale)),
        scale_sd=float(np.sqrt(covariance[POSE, POSE])) if problem.model.free else 0.0,
        weights=state.weights,
        weight_sd=np.sqrt(np.diag(covariance)[first:]),
        stretch=_stretch(state.weights, covariance[first:, first:]),
        deformed=deformed,
        vertex_sd_mm=_vertex_sd(problem.modes, covariance[first:, first:]),
        target_sd_mm=target_sd_mm,
        turn_sd_deg=turn_sd_deg,
        covariance=covariance[:POSE, :POSE],
        fit=_fit(problem, state, walls, places),
        margin=margin,
        iterations=end.steps,
        converged=end.converged,
    )
    reason = at_limit(scale, state.log_scale) or refusal(found) or closed or (None if len(problem.modes) else _RIGID)
    if reason is not None:
        return replace(found, reason=reason)
    return replace(found, status="registered", anatomy_T_camera=pose)


def _deformed(modes: Modes, weights: Float[np.ndarray, "k"]) -> tuple[Anatomy, str | None]:
    """The anatomy of these weights, and what is wrong with it: then it comes without passages."""
    mean = modes.mean
    if not weights.any():
        return mean, None
    said = " ".join(f"{one:+.2f}" for one in weights)
    parts = modes.vertices_mm(weights), f"{mean.name}, deformed", f"{mean.name} with modes at {said}"
    try:
        return carried_along(mean, *parts), None
    except PoseError:
        shape = carried_along(mean.with_(passages=()), *parts)
        return shape, "the most likely shape closes a passage: hardly one of the model's patients"


def _fit(problem: Problem, state: State, walls: Walls, places: Places) -> Fit:
    """Over the rays that exist."""
    found, real = residuals(problem, state, walls, places), problem.rays.valid != 0
    off = np.abs(found.error) / found.deviation
    fits = real & found.met & (off < _EXPLAINED_SD)
    if not fits.any():
        return Fit(np.inf, np.inf, np.inf, 0.0, np.inf)
    mm = np.abs(found.across_mm[fits])
    median, p95 = (float(np.percentile(mm, q)) for q in (50, 95))
    misfit = float(np.median(off[fits])) / 0.6745
    return Fit(median, float(mm.mean()), p95, float(fits.sum() / real.sum()), misfit)


def _stretch(weights: Float[np.ndarray, "k"], covariance: Float[np.ndarray, "k k"]) -> float:
    """Most likely weights of the model's patients have the covariance I − C, if C is what is left of doubt."""
    expected = len(weights) - float(np.trace(covariance))
    return float(weights @ weights) / expected if expected > 1e-9 else 0.0


def _in_view(
    problem: Problem, state: State, walls: Walls, places: Places, covariance: Float[np.ndarray, "u u"]
) -> tuple[float, float]:
    """How loose the walls in view are in the camera, by pose and shape together: each place (mm), and the turn of all.

    A pose in the frame of the mean is looser: what all of the walls in view do together, shape and pose share.
    """
    few = np.flatnonzero(places.met)[::_EVERY]
    if not len(few):
        return float("inf"), float("inf")
    some = Places(*(part[few] for part in vars(places).values()))
    rotation, camera = state.pose[:3, :3], state.pose[:3, 3]
    at = (walls.points_mm(some) - camera) @ rotation
    as_one = np.concatenate([np.broadcast_to(-np.eye(3), (len(few), 3, 3)), _cross(at)], axis=2)
    rows = np.zeros((len(few), 3, problem.unknowns))
    rows[:, :, :POSE] = as_one
    rows[:, :, problem.first_weight :] = np.einsum("ab,nak->nbk", rotation, moves(problem, some))
    target = float(np.sqrt(np.einsum("nau,uw,naw->n", rows, covariance, rows, optimize=True).mean()))
    twist = np.linalg.pinv(as_one.reshape(-1, POSE)) @ rows.reshape(-1, problem.unknowns)
    turn = (twist @ covariance @ twist.T)[3:, 3:]
    return target, float(np.rad2deg(np.sqrt(max(np.linalg.eigvalsh(turn)[-1], 0.0))))


def _cross(at: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The matrices whose product with a vector is at × vector: how a point moves as the camera turns about itself."""
    x, y, z = at.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _vertex_sd(modes: Modes, covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "v"]:
    if not len(modes):
        return np.zeros(len(modes.mean.vertices_mm))
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(modes))).astype(np.float32)
    return np.linalg.norm(modes.by_vertex_mm @ root, axis=(1, 2)).astype(np.float64)
