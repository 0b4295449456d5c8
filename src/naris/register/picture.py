"""The registration of a picture alone: by how far away a network believes walls to be, then by their shading.

The network knows no anatomy, so what it tells is off smoothly, by a tenth or more; that finds the place, but the pose
only roughly. Shading is exact but has a narrow basin. So the best few places by depth are each moved until our picture
from there is shaded as the real one, and the likeliest by both is the answer. Its probability has a fit of its own.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.core.results import DepthEstimate, Registration
from naris.register.astray import astray
from naris.register.evidence import Evidence, chance_within
from naris.register.map import RegistrationMap
from naris.register.observation import Observation, from_estimate
from naris.register.register import RegisterConfig, covariance_of, search, too_little
from naris.register.shading import Shaded, Shading
from naris.register.solve import BASIN_MM, BASIN_RAD, Solutions, alike, different
from naris.register.starts import NOTHING, Belief
from naris.render.scene import Scene

FITTED = "confidence_pictures.json"
_MOST_MARGIN, _MOST_OFF = 60.0, 3.0
_LEAST_EXPLAINED, _HARDLY = 0.6, 0.02
_LOOSE_MM, _LOOSE_RAD = 4.0, 0.2
"""How far shading may move a pose from where depth has it: the errors of the network are larger than what it says."""


SEARCH = RegisterConfig()
"""By depth: as of a depth image, though that of a network is rougher."""


@dataclass(frozen=True)
class PictureConfig:
    """How much is tried.

    Attributes:
        search: of the search by depth.
        places: that are looked at by their shading; the probability was fitted with as many as by default.
    """

    search: RegisterConfig = SEARCH
    places: int = 12


class Place(NamedTuple):
    """One that was looked at.

    Attributes:
        shaded: its pose and what the picture tells of it.
        off: how far shading moved it, squared, in what depth leaves free.
        cost: −2 log likelihood of depth and picture, but for a constant.
        number: of the solution by depth.
        covariance: of the twist in the camera (mm, rad), by the equations.
    """

    shaded: Shaded
    off: float
    cost: float
    number: int
    covariance: Float[np.ndarray, "6 6"]


class PictureEvidence(NamedTuple):
    """What speaks for and against the best place.

    Attributes:
        depth: the evidence of the registration by depth, for its own best place.
        places: best first, of different basins.
        claimed: the smooth error that the network claims.
        scale_off: how far the scale ended from what the network said, in deviations.
    """

    depth: Evidence
    places: list[Place]
    claimed: float
    scale_off: float

    @property
    def margin(self) -> float:
        """How much dearer the best place in another basin is."""
        return self.places[1].cost - self.places[0].cost if len(self.places) > 1 else math.inf

    @property
    def features(self) -> Float[np.ndarray, "f"]:
        """For the regression, each of the order of 1."""
        best, depth = self.places[0], self.depth
        within = chance_within(best.covariance)
        sd = np.sqrt(np.diag(best.covariance))
        others = [one.shaded.cost for one in self.places[1:]]
        return np.array(
            [
                np.log1p(min(max(self.margin, 0.0), _MOST_MARGIN)),
                np.log1p(min(max(depth.margin, 0.0), _MOST_MARGIN)),
                float(np.clip(depth.rough_margin, -30.0, 60.0)) / 30,
                float(best.number == 0),
                best.shaded.cost / 30,
                float(np.clip(min(others, default=best.shaded.cost) - best.shaded.cost, -60.0, 60.0)) / 30,
                np.log1p(best.off),
                abs(math.log(max(best.shaded.contrast, 0.05))),
                np.log(np.linalg.norm(sd[:3]) + 0.01),
                np.log(np.rad2deg(np.linalg.norm(sd[3:])) + 0.1),
                np.log(within / (1 - within)),
                10 * (depth.explained - 0.95),
                float(np.clip(depth.excess, -2.0, 3.0)),
                depth.agreement,
                np.log(depth.scatter + 0.05),
                np.log(self.claimed),
                min(abs(self.scale_off), _MOST_OFF),
                min(depth.clearance_mm, 4.0),
            ]
        )

    def refusal(self, chance: float, least: float) -> str | None:
        """Why the pose should not be used; None where it may be."""
        if chance >= least:
            return None
        if self.margin < 6.0:
            return f"several places look alike in this picture (probability {chance:.2f}): give depth, or another view"
        return (
            f"the picture alone does not tell the pose surely enough: probability {chance:.2f} where {least:.2f} is "
            "asked; give depth, or another view"
        )


def register_picture(
    at: RegistrationMap,
    scene: Scene,
    seen: tuple[UInt8[np.ndarray, "h w 3"], Intrinsics, DepthEstimate],
    belief: Belief = NOTHING,
    config: PictureConfig = PictureConfig(),
) -> Registration:
    """Find `anatomy_T_camera` of the camera that took a picture.

    Args:
        at: the anatomy (`registration_map`).
        scene: the same, to render.
        seen: the frame (H, W, 3) sRGB, its camera, and how far away a network (`naris.locate.depth`) says walls are.
        belief: what is known beforehand of region or pose.
        config: how much is tried.

    Returns:
        as of `naris.register.register.register`; the scale is what ranges of the network are to be multiplied with, as
        depth has it before shading moves the pose.

    Raises:
        ImageError: if frame and camera differ in size.
        PoseError, RegionError, InputError: as `naris.register.register.register`.
    """
    frame, intrinsics, estimate = seen
    observation = from_estimate(estimate)
    evidence = looked_at(at, Shading(scene, frame, intrinsics), observation, belief, config)
    chance, best = probability(evidence), evidence.places[0]
    where = astray(at, belief, best.shaded.pose)
    todo = "give depth, or another view" if belief.regions is None else "give depth, another view, or no region"
    reason = f"the best pose is {where}: {todo}" if where else None
    reason = reason or too_little(belief, config.search)
    reason = reason or evidence.refusal(chance, config.search.least_probability)
    poses = [one.shaded.pose for one in evidence.places]
    return Registration(
        anatomy_T_camera=poses[0] if reason is None else None,
        best=poses[0],
        status="registered" if reason is None else "refused",
        reason=reason,
        probability=chance,
        scale=float(np.exp(evidence.scale_off * observation.scale.sd_log)) * observation.scale.factor,
        cost=best.cost / len(observation),
        margin=evidence.margin,
        covariance=covariance_factor() * best.covariance,
        alternatives=Pose(np.array([pose.matrix for pose in poses[1:]]).reshape(-1, 4, 4), at.anatomy.frame, CAMERA),
    )


def looked_at(
    at: RegistrationMap, shading: Shading, observation: Observation, belief: Belief, config: PictureConfig
) -> PictureEvidence:
    """The places that depth offers, moved by their shading, and what speaks for the best."""
    found = search(at, observation, belief, config.search)
    solutions = found.solutions
    basins = different(solutions, config.places, BASIN_MM, BASIN_RAD)
    places = sorted((_place(at, shading, solutions, int(k)) for k in basins), key=lambda place: place.cost)
    apart: list[Place] = []
    for one in places:  # two of them may have met
        others = np.stack([other.shaded.pose.matrix for other in apart]) if apart else np.zeros((0, 4, 4))
        if not alike(others, one.shaded.pose.matrix, BASIN_MM, BASIN_RAD).any():
            apart.append(one)
    depth = Evidence.of(at, observation, found, basins, covariance_of(solutions, 0))
    scale = observation.scale
    off = float(solutions.log_scales[apart[0].number]) - math.log(scale.factor)
    return PictureEvidence(depth, apart, observation.smooth, off / scale.sd_log if scale.kind == "prior" else 0.0)


def _place(at: RegistrationMap, shading: Shading, solutions: Solutions, number: int) -> Place:
    pose = Pose(solutions.poses[number], at.anatomy.frame, CAMERA)
    loose = np.diag([_LOOSE_MM**2] * 3 + [_LOOSE_RAD**2] * 3)
    information = np.linalg.inv(covariance_of(solutions, number) + loose)
    shaded = shading.refined(pose, information)
    by = (pose.inverse() @ shaded.pose).log()
    off = float(by @ information @ by)
    cost = solutions.rays * float(solutions.costs[number]) + off + shaded.cost
    return Place(shaded, off, cost, number, np.linalg.inv(information + shaded.precision))


def probability(evidence: PictureEvidence) -> float:
    """Of being within 2 mm and 5° of the truth, for patients, looks and wrong patients as in the simulated trials."""
    file = _file()
    score = float(evidence.features @ np.array(file["weights"]) + file["bias"])
    chance = float(1 / (1 + np.exp(-np.clip(score, -30, 30))))
    return min(chance, _HARDLY) if evidence.depth.explained < _LEAST_EXPLAINED else chance


def covariance_factor() -> float:
    """What a covariance by the equations is multiplied with for errors of right poses to be as large as it says."""
    return float(_file()["covariance"])


@lru_cache(maxsize=1)
def _file() -> dict[str, Any]:
    return dict(json.loads(resources.files("naris.register").joinpath(FITTED).read_text(encoding="utf-8")))
