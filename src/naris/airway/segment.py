"""The nasal airway of a CT, by classical means: air, cut from the room, from the mouth and from the sinuses.

What is surely air decides what is what. A ball that comes from the front tells the room from the nostrils; the ways
with most room from either nostril to the pharynx run through the two sides of the nose; the air is divided at its
narrow places, and the parts along the ways and the slits that open into them are the nasal cavity. What else is
connected, and not to the room, is a sinus (`naris.airway.sinuses`) or the mouth. Only then the labels grow to the
boundary, half-way between air and the tissue around it (`naris.airway.boundary`): at that level a thin septum may have
holes, through which nothing leaks any more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from scipy.ndimage import binary_dilation, center_of_mass, distance_transform_edt, label

from naris.airway.basins import CLEFT_MM, Basins, basins_of, nasal_parts, wall_mm
from naris.airway.block import TOUCHING, Block, block_of
from naris.airway.boundary import air_level
from naris.airway.face import AIR_HU, Opening, nose_tip_mm, nostril_mm, nostrils, room_air
from naris.airway.front import check_front, front_of
from naris.airway.near import box_of
from naris.airway.plausible import check_plausible
from naris.airway.septum import given_back, mirrored_parts, septum_of
from naris.airway.sinuses import SINUSES, Extent, named
from naris.airway.ways import choana_row, pharynx_nodes, sides, ways_in
from naris.core.volume import LPS, Volume
from naris.ct.scan import Finding
from naris.errors import ScanError

STEP_MM = 0.5
SEGMENTS = ("right nasal cavity", "left nasal cavity", "nasopharynx", "other attached cavities", *SINUSES)
"""The names of labels 1, 2, 3, …"""
RIGHT, LEFT, NASOPHARYNX, ATTACHED = 1, 2, 3, 4
NOSE = (RIGHT, LEFT, NASOPHARYNX)
"""What a scope goes through; the other labels are what opens into it."""

_BESIDE_MM, _BEHIND_MM, _ABOVE_MM, _BELOW_MM = 55.0, 125.0, 75.0, 45.0  # of the tip of the nose, the block reaches
_FLOOR_MM = 25.0  # below the nasal floor the pharynx is cut
_GROWN_MM = 1.0
_LEAST_ROWS = 20
_MOST_AIR_ML = 300.0  # nose, sinuses, an open mouth and the throat have 100 to 200
_SKIN = 0.1
_NOSTRILS_MM = 12.0  # below the tip of the nose they have ended
_THROUGH_MM = 4.0


@dataclass(frozen=True, eq=False)
class Airway:
    """A segmented nose.

    Attributes:
        labels: (nx, ny, nz) 0 outside, else 1 + the index in `SEGMENTS`.
        block: the lattice and the values that they were found in.
        level: (nx, ny, nz) HU below the boundary to tissue: positive in air.
        landmarks_mm: (3,) in LPS by name: `left.nostril` (a millimetre inside its rim), `left.choana` (the
            middle of what leads on from the last coronal section), `left.nasal floor` and those of the right,
            `anterior tip`, `posterior wall`, `nasopharynx` (its roomiest place).
        findings: what a user should know.
    """

    labels: UInt8[np.ndarray, "nx ny nz"]
    block: Block
    level: Float32[np.ndarray, "nx ny nz"]
    landmarks_mm: dict[str, Float[np.ndarray, "3"]]
    findings: tuple[Finding, ...] = ()

    @property
    def frame_T_index(self) -> Float[np.ndarray, "4 4"]:
        return self.block.frame_T_index

    def volume_ml(self, segment: int) -> float:
        """Of one label."""
        return float((self.labels == segment).sum()) * self.block.step_mm**3 / 1000


def segment_airway(volume: Volume, step_mm: float = STEP_MM) -> Airway:
    """Find the nasal airway.

    Args:
        volume: a CT of a head in LPS.
        step_mm: of the lattice to work on.

    Raises:
        ScanError: if the volume is not in LPS, shows no nose, or no air leads from the nostrils to the pharynx.
    """
    if volume.frame != LPS:
        raise ScanError("a scan in LPS", f"one in {volume.frame}", "turn it into LPS first")
    tip_mm = nose_tip_mm(volume)
    before, behind = np.array([_BESIDE_MM, 15.0, _BELOW_MM]), np.array([_BESIDE_MM, _BEHIND_MM, _ABOVE_MM])
    block = block_of(volume, step_mm, tip_mm - before, tip_mm + behind)
    room = room_air(block)
    airway = _largest((block.hu < AIR_HU) & ~room)
    if (ml := float(airway.sum()) * step_mm**3 / 1000) > _MOST_AIR_ML:
        raise ScanError(
            f"at most {_MOST_AIR_ML:g} ml of air inside the head", f"{ml:.0f} ml", "this may be no CT of a head"
        )
    at_front = check_front(front_of(volume, block), block, airway, room)
    wall = wall_mm(airway, step_mm)
    openings, right, left = _two_ways(block, airway, room, wall, tip_mm)
    basins = basins_of(airway, wall, step_mm)
    labels = _labels(basins, airway, wall, right, left, block)
    labels[_along_skin(basins, airway, room) & (labels == ATTACHED)] = 0
    rims = {side: nostril_mm(openings[side], way, block) for side, way in (("right", right), ("left", left))}
    labels = named(labels, ATTACHED, basins, block, _landmarks(block, labels, wall, rims, tip_mm))
    level = air_level(block)
    labels = _grown(labels, level, room, step_mm)
    landmarks = _landmarks(block, labels, wall, rims, tip_mm)
    room_hu = float(np.median(block.hu[room])) if room.any() else -1000.0
    cavities = {"right": labels == RIGHT, "left": labels == LEFT}
    findings = check_plausible(volume, block, cavities, labels == NASOPHARYNX, wall, room_hu, landmarks)
    return Airway(labels, block, level, landmarks, (*at_front, *findings))


def _along_skin(
    basins: Basins, airway: Bool[np.ndarray, "nx ny nz"], room: Bool[np.ndarray, "nx ny nz"]
) -> Bool[np.ndarray, "nx ny nz"]:
    """Parts much of which touches the room, and so belong to it; a sinus behind a thin wall hardly touches it."""
    touching = np.bincount(basins.part[airway & binary_dilation(room, TOUCHING)], minlength=len(basins.room_mm))
    size = np.bincount(basins.part.ravel(), minlength=len(basins.room_mm))
    return np.asarray((touching > _SKIN * np.maximum(size, 1))[basins.part])


def _largest(mask: Bool[np.ndarray, "nx ny nz"]) -> Bool[np.ndarray, "nx ny nz"]:
    parts, count = label(mask, TOUCHING)
    if not count:
        raise ScanError("air inside the head", "none", "give a CT of an open nose")
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(parts == sizes.argmax())


def _two_ways(
    block: Block,
    airway: Bool[np.ndarray, "nx ny nz"],
    room: Bool[np.ndarray, "nx ny nz"],
    wall: Float[np.ndarray, "nx ny nz"],
    tip_mm: Float[np.ndarray, "3"],
) -> tuple[dict[str, Opening], Int[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """The openings of both nostrils and the ways from them, right and left."""
    openings = nostrils(block, airway, room, tip_mm)
    goals = pharynx_nodes(block, airway, tip_mm)
    if len(openings) < 2 or not len(goals):
        raise _without(block, openings, tip_mm)
    pair = sorted(openings[:2], key=lambda one: float(one.middle[0]))  # x grows to the left
    ways = ways_in(wall, pair, goals)
    if len(ways) < 2:
        raise ScanError(
            "air from both nostrils to the pharynx",
            f"a way from {len(ways)} of them",
            "the other side may be packed or blocked: segment it by hand",
        )
    return {"right": pair[0], "left": pair[1]}, ways[0], ways[1]


def _without(block: Block, openings: list[Opening], tip_mm: Float[np.ndarray, "3"]) -> ScanError:
    """Why a scan without two open nostrils and a pharynx will not do, as far as can be seen."""
    expected = "two open nostrils and the pharynx behind them"
    below_mm = float(tip_mm[2] - block.origin_mm[2])
    if len(openings) >= 2:
        return ScanError(expected, "no air of the pharynx", "give a CT that reaches 90 mm behind the tip of the nose")
    if below_mm < _NOSTRILS_MM:
        got = f"a scan that ends {below_mm:.0f} mm below the tip of the nose"
        return ScanError(expected, got, "give one that holds the nostrils and the nasal floor")
    if not openings:
        hint = "both may be packed, or this is no head: give a CT of an open nose, or segment it by hand"
        return ScanError(expected, "no open nostril", hint)
    side = "left" if block.points_mm(openings[0].middle)[0] > tip_mm[0] else "right"
    other = "right" if side == "left" else "left"
    return ScanError(
        expected, f"one on the {side}", f"the {other} side may be packed or swollen shut: segment it by hand"
    )


def _labels(
    basins: Basins,
    airway: Bool[np.ndarray, "nx ny nz"],
    wall: Float[np.ndarray, "nx ny nz"],
    right: Int[np.ndarray, "n 3"],
    left: Int[np.ndarray, "m 3"],
    block: Block,
) -> UInt8[np.ndarray, "nx ny nz"]:
    through = np.unique(basins.part[tuple(np.concatenate([right, left]).T)])
    surely = nasal_parts(basins, through)[basins.part]
    extent = _extent(right, left, choana_row(surely, wall, right, left), block)
    middles = np.array(center_of_mass(basins.part > 0, basins.part, np.arange(1, len(basins.size))))
    elsewhere, in_cleft = (
        np.append(False, there(block.points_mm(middles))) for there in (extent.beyond, extent.in_cleft)
    )
    # The cleft may be pinched off in a scan, but what lies there is the nose.
    cleft = in_cleft & (basins.room_mm <= CLEFT_MM)
    nasal = (nasal_parts(basins, through, elsewhere) | cleft)[basins.part]
    row = choana_row(nasal, wall, right, left)
    labels = _with_sides(nasal, airway, wall, (right, left), row)
    septum = septum_of(labels, block.step_mm)
    if septum is not None:
        doubtful = (labels == ATTACHED) & (block.axis_mm(2) < extent.cells_mm)
        labels = mirrored_parts(given_back(labels, septum), doubtful, basins, septum)
    if row <= max(int(right[:, 1].min()), int(left[:, 1].min())):
        raise ScanError(
            "a septum between the two sides of the nose",
            "sides that meet at the nostrils",
            "use a finer lattice, or segment this scan by hand if the septum has a hole",
        )
    floor = int(np.concatenate([right[right[:, 1] < row], left[left[:, 1] < row]])[:, 2].min())
    low = max(floor - round(_FLOOR_MM / block.step_mm), 0)
    labels[:, row:, low:][nasal[:, row:, low:]] = NASOPHARYNX
    labels[airway & ~nasal & (labels == 0)] = ATTACHED
    return labels


def _with_sides(
    nasal: Bool[np.ndarray, "nx ny nz"],
    airway: Bool[np.ndarray, "nx ny nz"],
    wall: Float[np.ndarray, "nx ny nz"],
    ways: tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]],
    row: int,
) -> UInt8[np.ndarray, "nx ny nz"]:
    """What lies in front of the row of the choanae: right, left, and what is neither as attached."""
    front = nasal.copy()
    front[:, row:] = False
    labels = sides(front, wall, *ways).astype(np.uint8)
    labels[front & (labels == 0)] = ATTACHED  # a cleft that leads nowhere has no side
    other = airway & ~nasal
    other[:, row:] = False
    labels[other] = ATTACHED
    return labels


def _extent(right: Int[np.ndarray, "n 3"], left: Int[np.ndarray, "m 3"], row: int, block: Block) -> Extent:
    """About how a nose lies, from the ways to its choanae: their lowest node is near its floor."""
    before = block.points_mm(
        np.concatenate([way[way[:, 1] < max(row, int(way[:, 1].min()) + 1)] for way in (right, left)])
    )
    front = float(np.mean([block.points_mm(way[-1])[1] for way in (right, left)]))
    depth = max(float(block.origin_mm[1] + block.step_mm * row) - front, 1.0)
    return Extent(float(np.median(before[:, 0])), front, float(before[:, 2].min()), depth)


def _grown(
    labels: UInt8[np.ndarray, "nx ny nz"],
    level: Float32[np.ndarray, "nx ny nz"],
    room: Bool[np.ndarray, "nx ny nz"],
    step_mm: float,
) -> UInt8[np.ndarray, "nx ny nz"]:
    """The labels out to the boundary: all air within a millimetre, each node as the nearest labelled one."""
    box = box_of(labels > 0, 2 * (int(_GROWN_MM / step_mm) + 1))
    there = labels[box]
    known = (there > 0) | room[box]
    far, nearest = distance_transform_edt(~known, sampling=step_mm, return_indices=True)
    grown = np.zeros_like(labels)
    grown[box] = np.where((level[box] > 0) & (far <= _GROWN_MM), there[tuple(nearest)], 0)
    return grown


def _landmarks(
    block: Block,
    labels: UInt8[np.ndarray, "nx ny nz"],
    wall: Float32[np.ndarray, "nx ny nz"],
    nostrils_mm: dict[str, Float[np.ndarray, "3"]],
    tip_mm: Float[np.ndarray, "3"],
) -> dict[str, Float[np.ndarray, "3"]]:
    found = {"anterior tip": tip_mm}
    for side, number in (("right", RIGHT), ("left", LEFT)):
        of_side = labels == number
        rows = np.flatnonzero(of_side.any(axis=(0, 2)))
        if len(rows) < _LEAST_ROWS:
            raise ScanError(
                f"a {side} nasal cavity of some length", f"{len(rows)} rows of it", "segment this scan by hand"
            )
        first, last = int(rows[0]), int(rows[-1])
        found[f"{side}.nostril"] = nostrils_mm[side]
        found[f"{side}.choana"] = block.points_mm(_choana(labels, number, last, round(_THROUGH_MM / block.step_mm)))
        third = (last - first) // 3
        nodes = np.argwhere(of_side[:, first + third : last + 1 - third])
        lowest = nodes[nodes[:, 2].argmin()] + [0, first + third, 0]
        found[f"{side}.nasal floor"] = block.points_mm(lowest)
    pharynx = np.where(labels == NASOPHARYNX, wall, 0.0)
    roomiest = np.array(np.unravel_index(pharynx.argmax(), wall.shape))
    found["nasopharynx"] = block.points_mm(roomiest)
    wall_row = np.flatnonzero(labels[roomiest[0], :, roomiest[2]] == NASOPHARYNX)
    if len(wall_row):
        found["posterior wall"] = block.points_mm(np.array([roomiest[0], wall_row[-1], roomiest[2]]))
    return found


def _choana(labels: UInt8[np.ndarray, "nx ny nz"], side: int, last: int, through: int) -> Int[np.ndarray, "3"]:
    """The middle of what leads on from the last coronal section of a side: above its arch lies a wall behind."""
    section = labels[:, last] == side
    behind = labels[:, min(last + through, labels.shape[1] - 1)] == NASOPHARYNX
    nodes = np.argwhere(section & behind) if (section & behind).any() else np.argwhere(section)
    i, k = nodes[np.linalg.norm(nodes - nodes.mean(axis=0), axis=1).argmin()]
    return np.array([i, last, k])
