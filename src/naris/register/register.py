"""The registration: one function from an observation to a pose of the camera in the anatomy, or none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.core.pose import CAMERA, Pose
from naris.core.results import Registration
from naris.errors import InputError
from naris.register.confidence import covariance_factor, probability, refusal
from naris.register.evidence import Evidence, Found
from naris.register.finish import Solver, by_points
from naris.register.map import RegistrationMap
from naris.register.noise import Scale
from naris.register.observation import Observation
from naris.register.solve import BASIN_MM, BASIN_RAD, Solutions, aside, coarse, different, fine, merged, promising
from naris.register.starts import NOTHING, Belief, Starts, find_starts

_ALTERNATIVES = 4
_LEAST_CHANCE = 1e-3
_LIMIT = 1.01
"""A scale so near to a limit, as a factor, has ended there."""


@dataclass(frozen=True)
class RegisterConfig:
    """How much is tried.

    Attributes:
        starts: solved coarsely; of poses that are believed in alone at least all of these.
        finalists: solved finely, at most so many.
        aside: begun again a little beside the best of them; half as many of points, which have fewer dents.
        least_probability: a pose that is less likely than this to be within 2 mm and 5° is refused.
        seed: of the starts beside believed poses, and of those beside the best finalist.
        method: what the finalists are solved by: `naris` by rays and smooth error; of a known scale also `icp`, `imlp`
            or, with normals, `imlop` (`naris.register.likely_point`), and where they are installed `small_gicp`,
            `small_gicp_planes` and `open3d` (`naris.register.libraries`). Judged they are alike.

    The probability was fitted with as much as by default, from a pose with 8 starts, one finalist and none beside. With
    less, what is as likely in another place may not be found; then a pose is refused, unless any probability will do.
    """

    starts: int = 200
    finalists: int = 16
    aside: int = 4
    least_probability: float = 0.8
    seed: int = 0
    method: Solver = "naris"

    def __post_init__(self) -> None:
        if min(self.starts, self.finalists) < 1 or self.aside < 0:
            raise InputError(
                "at least one start and one finalist, and none or more beside the best", f"{self}", "correct them"
            )
        if not 0 <= self.least_probability <= 1:
            raise InputError("a probability from 0 to 1", f"{self.least_probability:g}", "give 0.8 for 80 %")


FROM_POSE = RegisterConfig(starts=8, finalists=1, aside=0)
"""As much as is enough where a pose is known, and as the probability was fitted with from there."""


def register(
    at: RegistrationMap,
    observation: Observation,
    belief: Belief = NOTHING,
    config: RegisterConfig = RegisterConfig(),
) -> Registration:
    """Find `anatomy_T_camera` of the (first) camera that saw this.

    Starts are compared in bulk with what is seen all around places inside the anatomy; the best of them are solved by
    robust Levenberg–Marquardt against the walls that the rays meet, then the best of those with the smooth error of the
    depth estimated beside the pose, and once more from beside the best. The most likely wins.

    Args:
        at: the anatomy (`registration_map`).
        observation: what was seen; of a cloud 1,024 points a view are used, evenly chosen.
        belief: what is known beforehand of region or pose.
        config: how much is tried.

    Raises:
        PoseError: if believed poses are in another frame.
        RegionError: if no believed region has room for a camera.
        InputError: if the method cannot be used on what was seen, or it lies further away than the anatomy is long; of
            ranges from `from_estimate`, for which the probability was not fitted.
        MachineError: if the library of the method is not installed.
    """
    if observation.by_network:
        raise InputError(
            "depth or points",
            "ranges that a network told from a picture",
            "use naris.register.picture.register_picture",
        )
    observation = observation.used()
    return _chosen(at, observation, search(at, observation, belief, config), (belief, config))


def search(at: RegistrationMap, observation: Observation, belief: Belief, config: RegisterConfig) -> Found:
    """All that `register` chooses from; arguments and errors are its own."""
    _check_size(at, observation)
    rng = np.random.default_rng(config.seed)
    starts = find_starts(at, observation, belief, config.starts, rng)
    rough = coarse(at, observation, starts)
    first = _finely(at, observation, promising(rough, config.finalists), belief, config)
    if not config.aside:
        return Found(rough, first, None)
    count = -(-config.aside // 2) if observation.is_cloud else config.aside
    again = _finely(at, observation, aside(first, at.anatomy.frame, count, rng), belief, config)
    return Found(rough, merged(first, again), again)


def _finely(
    at: RegistrationMap, observation: Observation, starts: Starts, belief: Belief, config: RegisterConfig
) -> Solutions:
    if config.method == "naris":
        return _with_belief(fine(at, observation, starts), belief)
    return _with_belief(by_points(at, observation, starts, config.method), belief)


def _check_size(at: RegistrationMap, observation: Observation) -> None:
    low, high = at.anatomy.bounds_mm
    across = float(np.linalg.norm(high - low))
    median = float(np.median(observation.ranges)) * observation.scale.factor
    if observation.scale.kind != "unknown" and median > across:
        raise InputError(
            f"distances that fit into {at.anatomy.name}, which is {across:.0f} mm across",
            f"a median of {median:.0f} mm",
            "check the unit: what a step of a depth image is, or the scale",
        )


def _with_belief(solutions: Solutions, belief: Belief) -> Solutions:
    """Sorted by what they cost with the chance of their region."""
    chance = belief.chance(solutions.poses[:, :3, 3])
    costs = solutions.costs - 2 * np.log(np.maximum(chance, _LEAST_CHANCE)) / solutions.rays
    order = np.argsort(costs, kind="stable")
    matrices = None if solutions.matrices is None else solutions.matrices[order]
    return Solutions(
        solutions.poses[order], solutions.log_scales[order], costs[order], solutions.rays, solutions.model, matrices
    )


def _chosen(
    at: RegistrationMap, observation: Observation, found: Found, how: tuple[Belief, RegisterConfig]
) -> Registration:
    solutions = found.solutions
    basins = different(solutions, _ALTERNATIVES, BASIN_MM, BASIN_RAD)
    poses = Pose(solutions.poses[basins], at.anatomy.frame, CAMERA)
    covariance = covariance_of(solutions, 0)
    evidence = Evidence.of(at, observation, found, basins, covariance)
    chance = probability(evidence)
    reason = at_limit(observation.scale, float(solutions.log_scales[0])) or too_little(*how)
    reason = refusal(evidence, chance, how[1].least_probability) if reason is None else reason
    return Registration(
        anatomy_T_camera=poses[0] if reason is None else None,
        best=poses[0],
        status="registered" if reason is None else "refused",
        reason=reason,
        probability=chance,
        scale=float(np.exp(solutions.log_scales[0])),
        cost=float(solutions.costs[0]),
        margin=evidence.margin,
        covariance=covariance_factor(observation) * covariance,
        alternatives=poses[1:],
    )


def too_little(belief: Belief, config: RegisterConfig) -> str | None:
    """Why a probability tells little: less is tried than it was fitted with; None if not, or where any will do."""
    fitted = FROM_POSE if belief.only_poses else RegisterConfig()
    enough = all(getattr(config, name) >= getattr(fitted, name) for name in ("starts", "finalists", "aside"))
    if enough or not config.least_probability:
        return None
    return (
        f"less was tried than its probability was fitted with ({fitted.starts} starts, {fitted.finalists} finalists, "
        f"{fitted.aside} beside the best): try as much, or take any with a least probability of 0"
    )


def at_limit(scale: Scale, log_scale: float) -> str | None:
    """Why a scale that was sought between limits tells nothing; None where it came to rest between them."""
    factor = float(np.exp(log_scale))
    if scale.kind != "unknown" or scale.low * _LIMIT < factor < scale.high / _LIMIT:
        return None
    return (
        f"the scale ended at the limit of what was sought, {scale.low:.3g} to {scale.high:.3g} mm a unit: "
        "seek further, or give a prior"
    )


def covariance_of(solutions: Solutions, k: int) -> Float[np.ndarray, "6 6"]:
    """Of the twist in the camera (mm, rad), scale and smooth error left free: the block of the inverse."""
    matrix = solutions.matrices[k] if solutions.matrices is not None else np.eye(6)
    return np.linalg.inv(matrix + 1e-9 * np.eye(len(matrix)))[:6, :6]
