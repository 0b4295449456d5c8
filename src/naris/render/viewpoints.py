"""Where cameras stand and what they look at: viewpoints, the distributions that they are drawn from, and their checks.

What the camera looks at matters more to a localizer than its network, so a view distribution is a named set of numbers
that every data set, checkpoint and report repeats. `INSPECTION` is an endoscopist's view: along the passage, with some
depth ahead. `TRAVEL` is the same on every way in, each stretch of it equally often. `ANYWHERE` is the hardest: any
place with room, many views of a bare wall.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.anatomy.distance import SignedDistance
from naris.anatomy.passages import find_passages
from naris.core.anatomy import NOWHERE, Anatomy, Passage, RegionSet
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.errors import InputError, PoseError, RegionError
from naris.render.appearance import Appearance
from naris.render.directions import Bearings, aims, bearings, tilted, upright
from naris.render.near import neighbours, turned_away
from naris.render.scene import Scene, render

FREE = -1
"""The trajectory and position of a view that belongs to none."""

_PROBE = Intrinsics.from_vertical_fov(8, 8, 45.0)
_ANY_LOOK = Appearance()
_TRIES = (2, 2, 4, 8, 16, 32, 64, 128, 256)
_FEWEST_PLACES = 40
_MOST_PLACES, _MOST_PLACES_IN_ALL = 20_000, 100_000
_STRETCH_MM = 3.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Viewpoints:
    """Camera poses with what a data set says of them.

    Attributes:
        anatomy_T_camera: (N,).
        region: (N,) the region that the camera stands in.
        trajectory: (N,) number of the trajectory, `FREE` for none.
        position: (N,) number of the position (the views of one position share it), `FREE` for none.
    """

    anatomy_T_camera: Pose
    region: Int[np.ndarray, "n"]
    trajectory: Int[np.ndarray, "n"]
    position: Int[np.ndarray, "n"]

    @staticmethod
    def free(anatomy_T_camera: Pose, region: Int[np.ndarray, "n"]) -> Viewpoints:
        """Views that belong to no trajectory."""
        none = np.full(len(region), FREE)
        return Viewpoints(anatomy_T_camera, region, none, none)

    def __len__(self) -> int:
        return len(self.region)

    def __getitem__(self, index: Int[np.ndarray, "m"] | Bool[np.ndarray, "n"] | slice) -> Viewpoints:
        return Viewpoints(
            self.anatomy_T_camera[index], self.region[index], self.trajectory[index], self.position[index]
        )


def joined(parts: Sequence[Viewpoints]) -> Viewpoints:
    """Viewpoints of one frame in a row."""
    if len({(part.anatomy_T_camera.target, part.anatomy_T_camera.source) for part in parts}) != 1:
        raise PoseError("viewpoints in one frame", "several frames, or none", "join them apart")
    matrix = np.concatenate([part.anatomy_T_camera.matrix for part in parts])
    pose = parts[0].anatomy_T_camera
    return Viewpoints(
        Pose(matrix, pose.target, pose.source),
        np.concatenate([part.region for part in parts]),
        np.concatenate([part.trajectory for part in parts]),
        np.concatenate([part.position for part in parts]),
    )


@dataclass(frozen=True)
class ViewDistribution:
    """From which views are drawn.

    Attributes:
        name: to repeat in reports.
        clearance_mm: least distance to the wall. A region that has no such place gives its widest places.
        tilt_sd_deg: the viewing direction is the passage's, tilted by a normal angle of this size about each of two
            axes across; None tilts uniformly in solid angle.
        tilt_max_deg: larger tilts are drawn again.
        roll_sd_deg: the camera is then rolled by a normal angle of this size, from upright (`upright`).
        median_depth_mm: views whose median z-depth over a square picture of 45° is less are drawn again.
        balanced: draw each region equally often; else each place in the lumen.
        seen: views with less of that picture on a wall are drawn again too; a surface may have openings to see out of.
        even: within a region, each stretch of each passage equally often, as if each were travelled equally often;
            else each place, most of which lie in the widest parts.
        ahead_mm: before any tilt the camera is aimed by somebody who steers back to the passage, to be half as far
            beside it after so many mm (as `naris.render.trajectories.Steering`); None aims along the passage.
    """

    name: str
    clearance_mm: float
    tilt_sd_deg: float | None
    tilt_max_deg: float
    roll_sd_deg: float
    median_depth_mm: float
    balanced: bool
    seen: float = 0.3
    even: bool = False
    ahead_mm: float | None = None

    def __post_init__(self) -> None:
        sizes = (self.clearance_mm, self.tilt_sd_deg or 0.0, self.roll_sd_deg, self.median_depth_mm)
        if min(sizes) < 0 or not 0 < self.tilt_max_deg <= 180 or not 0 <= self.seen <= 1:
            raise InputError(
                "angles and distances from 0 up, a largest tilt of 0–180° and a share of 0–1", f"{self}", "correct them"
            )


INSPECTION = ViewDistribution(
    "inspection",
    clearance_mm=1.0,
    tilt_sd_deg=10.0,
    tilt_max_deg=35.0,
    roll_sd_deg=12.0,
    median_depth_mm=3.0,
    balanced=True,
)
"""Along the passage: two thirds of the views within 15° of it, rolled by 12°, a median of 3 mm or more ahead."""

TRAVEL = ViewDistribution(
    "travel",
    clearance_mm=1.0,
    tilt_sd_deg=12.0,
    tilt_max_deg=40.0,
    roll_sd_deg=12.0,
    median_depth_mm=3.0,
    balanced=True,
    even=True,
    ahead_mm=10.0,
)
"""As `INSPECTION`, but as often in a narrow stretch of the way as in a wide one, and steered back to its middle."""

ANYWHERE = ViewDistribution(
    "anywhere",
    clearance_mm=1.2,
    tilt_sd_deg=None,
    tilt_max_deg=25.0,
    roll_sd_deg=25.0,
    median_depth_mm=0.0,
    balanced=False,
)
"""Any place with 1.2 mm of room, up to 25° off the passage, whatever is ahead: the hardest."""

VIEW_DISTRIBUTIONS = {distribution.name: distribution for distribution in (INSPECTION, TRAVEL, ANYWHERE)}


@dataclass(frozen=True, eq=False)
class ViewBank:
    """The places of a lumen that a distribution draws from, sorted by region; made once by `view_bank`.

    Attributes:
        places_mm: (M, 3) nodes of the distance grid with enough clearance.
        tangents: (M, 3) unit direction of the nearest passage in sight of each place, from outside to inside, or the
            aim of somebody who steers back to it.
        region: (M,) rising.
        starts: (K + 1,) the places of region k are starts[k] … starts[k + 1] − 1.
        room_mm: (K,) the clearance that the places of each region have at least.
        distance, regions, distribution: what it was made of.
        chances: (M + 1,) the chance of the places before each, added up; None where all are alike.
    """

    places_mm: Float[np.ndarray, "m 3"]
    tangents: Float[np.ndarray, "m 3"]
    region: Int[np.ndarray, "m"]
    starts: Int[np.ndarray, "k1"]
    room_mm: Float[np.ndarray, "k"]
    distance: SignedDistance
    regions: RegionSet
    distribution: ViewDistribution
    chances: Float[np.ndarray, "m1"] | None = None


def view_bank(
    distance: SignedDistance, passages: Sequence[Passage], regions: RegionSet, distribution: ViewDistribution
) -> ViewBank:
    """Find the places that a distribution can draw from (about a second).

    Raises:
        RegionError: if there is no passage, regions and distances are in different frames, or a region has no place.
    """
    if not passages or regions.frame != distance.frame:
        raise RegionError(
            f"passages, and regions in the frame {distance.frame!r}",
            f"{len(passages)} passages and {regions.frame!r}",
            "find the passages of the anatomy first, and give a region set of the same anatomy",
        )
    inside = np.argwhere(distance.values_mm > min(0.3, distribution.clearance_mm))
    places = distance.origin_mm + distance.spacing_mm * inside
    clearance = distance.values_mm[tuple(inside.T)].astype(np.float64)
    region = regions.label(places).astype(np.int64)
    room = _room(region, clearance, regions, distribution.clearance_mm)
    keep = np.flatnonzero((region != NOWHERE) & (clearance >= room[region]))
    keep = _thinned(keep, region, distribution.balanced)
    keep = keep[np.argsort(region[keep], kind="stable")]
    places, region = places[keep], region[keep]
    starts = np.searchsorted(region, np.arange(len(regions.names) + 1))
    beside = bearings(places, distance, passages)
    ahead_mm = distribution.ahead_mm
    tangents = beside.way if ahead_mm is None else aims(beside.way, beside.goal_mm - places, ahead_mm)
    chances = _even_chances(region, beside) if distribution.even else None
    return ViewBank(places, tangents, region, starts, room, distance, regions, distribution, chances)


def draw_views(scene: Scene, bank: ViewBank, n: int, rng: np.random.Generator, avoid: Pose | None = None) -> Viewpoints:
    """Draw `n` views, in random order; with a balanced distribution each region comes ⌊n/K⌋ or ⌈n/K⌉ times.

    Args:
        scene: what is seen.
        bank: where views come from.
        n: how many.
        rng: of everything random.
        avoid: views that stay unseen: a camera near one of them looks just past it (`naris.render.near`), and where
            it cannot, another is drawn.

    Raises:
        RegionError: if a region has no view of the asked depth.
    """
    wanted = _regions_wanted(bank, n, rng)
    matrix = np.empty((n, 4, 4))
    still = np.arange(n)
    for tries in _TRIES:
        if not len(still):
            break
        tried = np.repeat(still, tries)
        place, position_mm = _stand(bank, wanted[tried], rng)
        poses = _look(bank, place, position_mm, rng)
        if avoid is not None:
            poses = turned_away(avoid, poses, rng)
        fits = sees_ahead(scene, poses, bank.distribution.median_depth_mm, bank.distribution.seen)
        if avoid is not None:
            fits &= ~neighbours(avoid, poses)
        good = np.flatnonzero(fits)
        matrix[tried[good]] = poses.matrix[good]
        still = np.setdiff1d(still, tried[good], assume_unique=False)
    if len(still):
        names = sorted({bank.regions.names[k] if k >= 0 else "the lumen" for k in wanted[still].tolist()})
        raise RegionError(
            f"views with a median depth of {bank.distribution.median_depth_mm} mm or more in {', '.join(names)}"
            + ("" if avoid is None else ", away from those to avoid"),
            f"none in {sum(_TRIES)} tries",
            "lower the depth or merge the region with a neighbour",
        )
    anatomy_T_camera = Pose(matrix, bank.regions.frame, "camera")
    return Viewpoints.free(anatomy_T_camera, bank.regions.label(anatomy_T_camera.position_mm).astype(np.int64))


def check_in_lumen(distance: SignedDistance, anatomy_T_camera: Pose, clearance_mm: float = 0.0) -> None:
    """See that cameras (N,) stand inside the lumen, with some clearance if asked.

    Raises:
        PoseError: if one does not; the message names the first.
    """
    if anatomy_T_camera.target != distance.frame:
        raise PoseError(f"poses in the frame {distance.frame!r}", f"{anatomy_T_camera.target!r}", "transform them")
    clearance = distance(anatomy_T_camera.position_mm)
    outside = np.flatnonzero(clearance <= clearance_mm)
    if len(outside):
        first = int(outside[0])
        place = ", ".join(f"{x:.1f}" for x in anatomy_T_camera.position_mm[first])
        where = f"{-clearance[first]:.1f} mm outside" if clearance[first] <= 0 else f"{clearance[first]:.1f} mm off"
        raise PoseError(
            f"cameras inside the lumen{f', {clearance_mm} mm from its wall or more' if clearance_mm else ''}",
            f"{len(outside)} of {len(clearance)} that are not, the first (number {first}) at ({place}) mm, {where}",
            "check the frame and the unit of the poses",
        )


def passages_of(anatomy: Anatomy, distance: SignedDistance) -> tuple[Passage, ...]:
    """The passages that an anatomy comes with, or else those found in it (some seconds)."""
    return anatomy.passages or find_passages(anatomy, distance)


def _even_chances(region: Int[np.ndarray, "m"], beside: Bearings) -> Float[np.ndarray, "m1"]:
    """Chances, added up, that make each stretch of each passage equally likely and all regions alike.

    A stretch that a border cuts has its chance in both regions together: the corner of it that lies beyond a border
    would else be seen as often as a whole one.
    """
    stretch = (beside.depth_mm / _STRETCH_MM).astype(np.int64)
    stretch += (stretch.max() + 1) * beside.passage
    chance = 1 / np.bincount(stretch)[stretch]
    chance /= np.bincount(region, chance)[region]
    return np.concatenate([[0.0], np.cumsum(chance)])


def _room(
    region: Int[np.ndarray, "m"], clearance: Float[np.ndarray, "m"], regions: RegionSet, asked_mm: float
) -> Float[np.ndarray, "k"]:
    """The clearance to ask in each region: what was asked, or what its widest places have."""
    room = np.full(len(regions.names), asked_mm)
    for k, name in enumerate(regions.names):
        widest = np.sort(clearance[region == k])[::-1]
        if not len(widest):
            raise RegionError(
                f"room for a camera in every region of {regions.name!r}", f"none in {name!r}", "merge it with another"
            )
        fewest = min(_FEWEST_PLACES, len(widest))
        if widest[fewest - 1] < asked_mm:
            room[k] = widest[fewest - 1]
            _log.info("%s has no %.1f mm of room for a camera: its widest places have %.1f mm", name, asked_mm, room[k])
    return room


def _thinned(keep: Int[np.ndarray, "m"], region: Int[np.ndarray, "n"], balanced: bool) -> Int[np.ndarray, "l"]:
    """Enough places to draw from: in each region where regions are drawn equally often, else in all."""
    mixed = np.random.default_rng(0).permutation(keep)
    if not balanced:
        return mixed[:_MOST_PLACES_IN_ALL]
    return np.concatenate([mixed[region[mixed] == k][:_MOST_PLACES] for k in np.unique(region[keep])])


def _regions_wanted(bank: ViewBank, n: int, rng: np.random.Generator) -> Int[np.ndarray, "{n}"]:
    """A region for each view, or −1 for any."""
    if not bank.distribution.balanced:
        return np.full(n, -1)
    k = len(bank.regions.names)
    rest = rng.permutation(k)[: n % k]
    return rng.permutation(np.concatenate([np.repeat(np.arange(k), n // k), rest]))


def _stand(
    bank: ViewBank, wanted: Int[np.ndarray, "n"], rng: np.random.Generator
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """A place of the bank for each wanted region, and a position near it."""
    first = np.where(wanted < 0, 0, bank.starts[wanted])
    last = np.where(wanted < 0, len(bank.region), bank.starts[wanted + 1])
    place = _places(bank, first, last, rng.random(len(wanted)))
    node = bank.places_mm[place]
    near = node + bank.distance.spacing_mm * (rng.random((len(wanted), 3)) - 0.5)
    fits = (bank.distance(near) >= bank.room_mm[bank.region[place]]) & (bank.regions.label(near) == bank.region[place])
    return place, np.where(fits[:, None], near, node)


def _look(
    bank: ViewBank, place: Int[np.ndarray, "n"], position_mm: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> Pose:
    """Cameras at these positions, not yet checked for depth."""
    forward = tilted(bank.tangents[place], _tilts_rad(bank.distribution, len(place), rng), rng)
    roll_rad = np.deg2rad(bank.distribution.roll_sd_deg) * rng.standard_normal(len(place))
    return Pose.look(position_mm, forward, upright(forward), bank.regions.frame, roll_rad)


def _places(
    bank: ViewBank, first: Int[np.ndarray, "n"], last: Int[np.ndarray, "n"], share: Float[np.ndarray, "n"]
) -> Int[np.ndarray, "n"]:
    """A place from `first` to before `last`, at a share (0…1) of the chances between them."""
    if bank.chances is None:
        return first + (share * (last - first)).astype(np.int64)
    low, high = bank.chances[first], bank.chances[last]
    place = np.searchsorted(bank.chances, low + share * (high - low), side="right") - 1
    return np.clip(place, first, last - 1)


def _tilts_rad(distribution: ViewDistribution, n: int, rng: np.random.Generator) -> Float[np.ndarray, "{n}"]:
    share = rng.random(n)
    most = np.deg2rad(distribution.tilt_max_deg)
    if distribution.tilt_sd_deg is None:
        return np.arccos(1 - share * (1 - np.cos(most)))
    sd = max(np.deg2rad(distribution.tilt_sd_deg), 1e-9)
    # The length of a two-dimensional normal vector (Rayleigh), cut at the largest tilt, by inversion.
    return sd * np.sqrt(-2 * np.log1p(-share * -np.expm1(-0.5 * (most / sd) ** 2)))


def sees_ahead(
    scene: Scene, anatomy_T_camera: Pose, median_depth_mm: float, seen: float = 0.0
) -> Bool[np.ndarray, "n"]:
    """Whether the views (N,) have something to show, judged by 8×8 rays over a square of 45°.

    Args:
        scene: what is seen.
        anatomy_T_camera: (N,).
        median_depth_mm: least median z-depth; where there is no wall the depth counts as 0.
        seen: least share of the picture that shows a wall.
    """
    probe = render(scene, anatomy_T_camera, _PROBE, _ANY_LOOK, want=("depth",), threads=1)
    depth = cast(np.ndarray, probe.depth_mm).reshape(len(anatomy_T_camera), -1)
    return (np.median(depth, axis=1) >= median_depth_mm) & ((depth > 0).mean(axis=1) >= seen)
