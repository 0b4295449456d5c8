"""Trajectories: views on the way between keyframes, and keyframes that are set automatically along a passage.

In the manner of Sinha et al. 2018: somebody steers the camera through the lumen and saves a keyframe every several mm;
between keyframes the camera goes straight in steps of 1 mm, and ten views are taken at each position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from naris.anatomy.distance import SignedDistance
from naris.core.anatomy import Passage, RegionSet
from naris.core.pose import Pose
from naris.errors import InputError, RegionError
from naris.render.directions import aims, tangents, upright
from naris.render.keyframes import UP, Keyframes, Trajectory
from naris.render.viewpoints import Viewpoints

VIEWS_PER_POSITION = 10

_TRIES = 40
_MARCH_MM = 0.25
_SIDE_TURN_SD_RAD = 0.7
_AIM_MEMORY = 0.6
_LAST_MM = 0.5
_GRAZE_MM = 0.1
_RIDGE_MM = 0.3


@runtime_checkable
class Jitter(Protocol):
    """How the views of one position differ."""

    def views(
        self, trajectory: Trajectory, per_position: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "views 4 4"]:
        """Camera poses in the frame of the trajectory, `per_position` in a row for each position."""
        ...


@dataclass(frozen=True)
class OriginalJitter:
    """As the code published with Sinha et al. 2018: N(0, sd) is added to each component of the viewing direction.

    Attributes:
        sd: of a unit vector's components, without unit; 0.01 is about 0.57° in each direction across.
    """

    sd: float = 0.01

    def views(
        self, trajectory: Trajectory, per_position: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "views 4 4"]:
        position, forward, up = (
            np.repeat(of, per_position, axis=0)
            for of in (trajectory.positions_mm, trajectory.directions, trajectory.ups)
        )
        return Pose.look(position, forward + rng.normal(0, self.sd, forward.shape), up, trajectory.frame).matrix


@dataclass(frozen=True)
class SteadyHand:
    """Normal rotations about the axes of the camera, and normal moves sideways.

    Attributes:
        tilt_sd_deg: about the x and the y axis of the camera.
        roll_sd_deg: about its optical axis.
        lateral_sd_mm: along its x and y axes. Check that the views are still inside the lumen.
    """

    tilt_sd_deg: float = 3.0
    roll_sd_deg: float = 3.0
    lateral_sd_mm: float = 0.0

    def views(
        self, trajectory: Trajectory, per_position: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "views 4 4"]:
        still = np.repeat(trajectory.anatomy_T_camera.matrix, per_position, axis=0)
        n = len(still)
        turn_rad = np.deg2rad([self.tilt_sd_deg, self.tilt_sd_deg, self.roll_sd_deg]) * rng.standard_normal((n, 3))
        move_mm = np.array([self.lateral_sd_mm, self.lateral_sd_mm, 0.0]) * rng.standard_normal((n, 3))
        return still @ _moves(turn_rad, move_mm)


def jitter_views(
    trajectory: Trajectory,
    regions: RegionSet,
    rng: np.random.Generator,
    per_position: int = VIEWS_PER_POSITION,
    jitter: Jitter = OriginalJitter(),
) -> Viewpoints:
    """Take views at each position of a trajectory.

    The trajectory has number 0 and its positions 0, 1, …; `region` is where each camera stands.

    Raises:
        RegionError: if regions and trajectory are in different frames.
        InputError: if there is not at least one view a position.
    """
    if per_position < 1:
        raise InputError("one view a position or more", f"{per_position}", "give a number such as 10")
    if regions.frame != trajectory.frame:
        raise RegionError(f"regions in the frame {trajectory.frame!r}", f"{regions.frame!r}", "bring them to one frame")
    poses = Pose(jitter.views(trajectory, per_position, rng), trajectory.frame, "camera")
    position = np.repeat(np.arange(len(trajectory)), per_position)
    return Viewpoints(
        poses, regions.label(poses.position_mm).astype(np.int64), np.zeros(len(poses), dtype=np.int64), position
    )


@dataclass(frozen=True)
class Steering:
    """How a person steers through a passage, for trajectories that are made automatically.

    Attributes:
        spacing_mm: keyframes are this far apart along the passage (uniform between the two).
        clearance_mm: the camera keeps this far from the wall, at keyframes and between them.
        side_mm: how far to the side of the passage keyframes may stand, where there is room.
        ahead_mm: the camera looks along the passage, so that this far ahead it is half as far beside it.
        aim_sd_deg: how far from there its aim wanders about each of two axes, correlated from keyframe to keyframe.
        median_depth_mm: a view with less (as `sees_ahead` judges) is no use to a person who steers.
        fixed_up: keep +z up, as the viewer of the published code does; else hold the camera as `upright` says, which
            suits passages that rise steeply.
    """

    spacing_mm: tuple[float, float] = (3.0, 8.0)
    clearance_mm: float = 1.0
    side_mm: float = 4.0
    ahead_mm: float = 10.0
    aim_sd_deg: float = 6.0
    median_depth_mm: float = 3.0
    fixed_up: bool = False


PAPER_STEERING = Steering(fixed_up=True)
"""As the viewer of the published code holds the camera."""


def roomy_parts(passage: Passage, clearance_mm: float, least_length_mm: float = 5.0) -> tuple[Passage, ...]:
    """The stretches of a passage where a camera has this much room, longest first; none if all are too short."""
    roomy = np.flatnonzero(passage.clearance_mm >= clearance_mm)
    runs = np.split(roomy, np.flatnonzero(np.diff(roomy) > 1) + 1)
    parts = [Passage(passage.name, passage.points_mm[run], passage.clearance_mm[run]) for run in runs if len(run) > 1]
    return tuple(sorted((p for p in parts if p.length_mm >= least_length_mm), key=lambda p: -p.length_mm))


def measured(passage: Passage, distance: SignedDistance) -> Passage:
    """The passage with the clearance that the distance grid has, up to 0.3 mm less than the true one in slits."""
    return replace(passage, clearance_mm=distance(passage.points_mm))


def trajectory_along(
    passage: Passage, distance: SignedDistance, rng: np.random.Generator, steering: Steering = Steering()
) -> Keyframes:
    """Set keyframes along the longest roomy stretch of a passage, as a person would who steers through it.

    Each keyframe stands to the side of the passage where there is room, and looks ahead with a wandering aim. The
    straight way from keyframe to keyframe keeps the clearance but for 0.1 mm.

    Raises:
        RegionError: if the passage has no stretch of 5 mm with that clearance.
    """
    by_grid = measured(passage, distance)
    for slack_mm in (0.0, _RIDGE_MM):
        kept = replace(steering, clearance_mm=steering.clearance_mm - slack_mm)
        parts = roomy_parts(by_grid, kept.clearance_mm)
        if parts:
            break
    else:
        raise RegionError(
            f"a passage with {steering.clearance_mm} mm of room over 5 mm or more",
            f"{passage.name!r} without",
            "lower the clearance or take another passage",
        )
    course = _Course.along(parts[0], distance, kept)
    for _ in range(_TRIES):
        positions, stations = _steer(course, rng)
        if len(positions) > 1:
            break
    else:
        raise RegionError(f"a way along {passage.name!r}", "none that was free", "take another passage")
    directions = _aims(course, positions, stations, rng)
    up = np.array(UP) if steering.fixed_up else upright(directions)
    return Keyframes.of(Pose.look(positions, directions, up, distance.frame))


@dataclass(frozen=True, eq=False)
class _Course:
    """What one needs to steer: the passage, how far along it each point is (mm), its directions, and the walls."""

    points_mm: Float[np.ndarray, "n 3"]
    reach_mm: Float[np.ndarray, "n"]
    ways: Float[np.ndarray, "n 3"]
    distance: SignedDistance
    steering: Steering

    @staticmethod
    def along(passage: Passage, distance: SignedDistance, steering: Steering) -> _Course:
        return _Course(passage.points_mm, _reach_mm(passage), tangents(passage), distance, steering)

    def beside(self, station_mm: float, side_rad: float, share: float) -> Float[np.ndarray, "3"]:
        """The position at `station_mm` along the passage, out to the side by a share of the room there."""
        index = min(int(np.searchsorted(self.reach_mm, station_mm)), len(self.ways) - 1)
        way, point = self.ways[index], self.points_mm[index]
        across = np.cross(way, np.eye(3)[np.abs(way).argmin()])
        across /= np.linalg.norm(across)
        side = np.cos(side_rad) * across + np.sin(side_rad) * np.cross(way, across)
        out_mm = np.arange(_MARCH_MM, self.steering.side_mm + _MARCH_MM / 2, _MARCH_MM)
        line = point + out_mm[:, None] * side
        blocked = np.flatnonzero(self.distance(line) < self.steering.clearance_mm)
        free = int(blocked[0]) if len(blocked) else len(out_mm)
        return point if free == 0 else point + share * out_mm[free - 1] * side

    def is_free(self, start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]) -> bool:
        """Whether the straight way keeps the clearance, but for 0.1 mm."""
        n = int(np.ceil(np.linalg.norm(end - start) / _MARCH_MM)) + 1
        line = start + np.linspace(0, 1, n + 1)[:, None] * (end - start)
        return bool((self.distance(line) >= self.steering.clearance_mm - _GRAZE_MM).all())


def _steer(course: _Course, rng: np.random.Generator) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k"]]:
    """Keyframe positions, and how many mm along the passage each is."""
    low, high = course.steering.spacing_mm
    end_mm = float(course.reach_mm[-1])
    station, side_rad = float(rng.uniform(0, min(low, end_mm / 4))), float(rng.uniform(0, 2 * np.pi))
    positions, stations = [course.beside(station, side_rad, float(rng.random()))], [station]
    while stations[-1] < end_mm - _LAST_MM:
        for attempt in range(_TRIES):
            # Later tries take shorter steps and keep nearer to the passage, along which the way is free.
            ease = 1 - attempt / (_TRIES - 1)
            station = min(stations[-1] + max(ease * float(rng.uniform(low, high)), _LAST_MM), end_mm)
            turned = side_rad + float(rng.normal(0, _SIDE_TURN_SD_RAD))
            position = course.beside(station, turned, ease * float(rng.random()))
            if course.is_free(positions[-1], position):
                break
        else:
            break
        positions.append(position)
        stations.append(station)
        side_rad = turned
    return np.array(positions), np.array(stations)


def _aims(
    course: _Course, positions: Float[np.ndarray, "k 3"], stations: Float[np.ndarray, "k"], rng: np.random.Generator
) -> Float[np.ndarray, "k 3"]:
    """Viewing directions: along the passage and somewhat back to its middle, and a wander that goes on for a while."""
    index = np.minimum(np.searchsorted(course.reach_mm, stations), len(course.ways) - 1)
    back = course.points_mm[index] - positions
    aim = aims(course.ways[index], back, course.steering.ahead_mm)
    wander, wanders = rng.standard_normal(2), []
    for _ in positions:
        wanders.append(wander)
        wander = _AIM_MEMORY * wander + np.sqrt(1 - _AIM_MEMORY**2) * rng.standard_normal(2)
    across = np.cross(aim, upright(aim))
    off = np.tan(np.deg2rad(course.steering.aim_sd_deg)) * np.array(wanders)
    aim = aim + off[:, :1] * across + off[:, 1:] * np.cross(across, aim)
    return aim / np.linalg.norm(aim, axis=1, keepdims=True)


def _reach_mm(passage: Passage) -> Float[np.ndarray, "n"]:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1))])


def _moves(turn_rad: Float[np.ndarray, "n 3"], move_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4 4"]:
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn_rad).as_matrix()
    return Pose.of(rotation, move_mm, "camera", "camera").matrix
