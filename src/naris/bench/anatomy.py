"""How near to the truth a nose comes that was found in a CT: virtual patients there and back, and real scans.

A **round trip**: a nose of drawn parameters, its CT, the nose found in it. Real scans have no whole truth: one has
expert labels, of the other only the time is told. They are no part of naris; where they are not given (`--scans`),
their figures have no value.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import nrrd
import numpy as np
from jaxtyping import Bool, Float, UInt8

from naris.airway.segment import LEFT, NOSE, RIGHT, SEGMENTS, Airway, segment_airway
from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.distance import lumen_distance, signed_distance
from naris.anatomy.level_set import surface
from naris.anatomy.scanned import ScannedAnatomy, anatomy_of_airway
from naris.anatomy.transfer import transfer_regions
from naris.anatomy.triangles import index_triangles
from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.bench import BenchRequest, Measurement
from naris.bench.carried import Right, of_samples, of_transfers, references_of, right
from naris.bench.result import Figure
from naris.core.anatomy import Anatomy
from naris.core.provenance import file_digest
from naris.core.volume import LPS, Volume
from naris.ct.read import read_scan
from naris.ct.write import write_nrrd
from naris.errors import NarisError

TRIPS, QUICK_TRIPS = 30, 1
SCANNER = Scanner(spacing_mm=(0.5, 0.5, 1.0), noise_hu=25.0)
LABELLED, LABELS = Path("nasalseg-p001/P001_img.nrrd"), Path("nasalseg-p001/P001_seg.nrrd")
HEAD = Path("ct-head/ct_head.nii.gz")
LARGE = (512, 512, 400)
EXPERT = {"right": (RIGHT, 3), "left": (LEFT, 4)}
"""Our label and the expert's of either side; the expert's nasopharynx is 5."""
_SINUSES = {"right": 1, "left": 2}  # the expert's, maxillary

_RESAMPLED = 2000
_PLACES_MM, _ROOM_MM = 1.0, 1.0
_OPEN_MM = 8.0  # around a nostril the truth ends where a scan goes on
_POINTS = ("left.nostril", "right.nostril", "left.choana", "right.choana")
_ON_WALLS = ("left.nasal floor", "right.nasal floor", "posterior wall")
_BESIDE_MM = 1.0
_LOST_MM = 100.0  # counts for a landmark that was not found
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Trip:
    """What a round trip came to.

    Attributes:
        off_mm: distances between the surfaces, both ways, but near the nostrils.
        landmarks_mm: by name, how far each lies from where it was made.
        genus: of the surface that was found.
        kept: by region of the truth, the share of a camera's places in it that lie in what was found.
        regions: how right those were that were carried to it; None where none were.
    """

    off_mm: Float[np.ndarray, "n"]
    landmarks_mm: Mapping[str, float]
    genus: int
    kept: Mapping[str, float]
    regions: Right | None = None


def measure(request: BenchRequest) -> Measurement:
    """Round trips, and the real scans in the folder `request.scans` if there is one."""
    count = QUICK_TRIPS if request.quick else TRIPS
    trips: list[Trip] = []
    refused = 0
    references = references_of(request)
    with request.progress.task("round trips", count) as advance:
        for number in range(count):
            try:
                trips.append(round_trip(request.seed, number, references))
            except NarisError as error:
                _LOG.warning("round trip %d found no nose: %s", number, error)
                refused += 1
            advance(1)
    figures = [*_of_trips(trips, refused), *of_transfers(request, references), *of_samples(request, references)]
    figures += [*_of_labelled(request.scans), *_of_times(request)]
    return Measurement(tuple(figures), _inputs(request.scans))


def round_trip(seed: int, number: int, references: Sequence[Anatomy]) -> Trip:
    """One virtual patient, there and back, with regions carried from others.

    Raises:
        NarisError: if no nose is found in its scan.
    """
    truth = built_in_nose(drawn_parameters(np.random.default_rng([seed, number])))
    airway = segment_airway(virtual_ct(truth, SCANNER, seed + number))
    made = anatomy_of_airway(airway, "found", "a virtual CT")
    trip = compared(truth, airway, made)
    try:
        carried = transfer_regions(made.anatomy, references)
    except NarisError as error:
        _LOG.warning("round trip %d got no regions: %s", number, error)
        return trip
    return replace(trip, regions=right(carried, truth))


def compared(truth: Anatomy, airway: Airway, made: ScannedAnatomy) -> Trip:
    """What was found in a scan of an anatomy beside that anatomy."""
    marks = {name: float(np.linalg.norm(airway.landmarks_mm[name] - truth.landmarks_mm[name])) for name in _POINTS}
    marks |= on_walls(airway.landmarks_mm, truth)
    nostrils = np.stack([truth.landmarks_mm[f"{side}.nostril"] for side in EXPERT])
    return Trip(apart_mm(made.anatomy, truth, nostrils), marks, made.genus, kept(made.anatomy, truth, nostrils))


def on_walls(landmarks_mm: Mapping[str, Float[np.ndarray, "3"]], truth: Anatomy) -> dict[str, float]:
    """How far the landmarks that are named after a wall lie from that wall of the truth, along their axis.

    The nasal floor is the lowest place of the middle third of a side, the posterior wall what lies behind the roomiest
    place of the nasopharynx.
    """
    off, points = {}, truth.vertices_mm
    for side, sign in (("left", 1), ("right", -1)):
        front, back = (landmarks_mm[f"{side}.{name}"][1] for name in ("nostril", "choana"))
        third = (back - front) / 3
        middle = (points[:, 1] > front + third) & (points[:, 1] < back - third) & (sign * points[:, 0] > 1)
        lowest = float(points[middle, 2].min()) if middle.any() else np.inf
        off[f"{side}.nasal floor"] = min(abs(float(landmarks_mm[f"{side}.nasal floor"][2]) - lowest), _LOST_MM)
    roomiest = landmarks_mm["nasopharynx"]
    behind = (np.linalg.norm((points - roomiest)[:, [0, 2]], axis=1) < _BESIDE_MM) & (points[:, 1] > roomiest[1])
    wall = float(np.median(points[behind, 1])) if behind.any() else np.inf
    found = float(landmarks_mm["posterior wall"][1]) if "posterior wall" in landmarks_mm else -np.inf
    off["posterior wall"] = min(abs(found - wall), _LOST_MM)
    return off


def kept(found: Anatomy, truth: Anatomy, but_near_mm: Float[np.ndarray, "k 3"]) -> dict[str, float]:
    """By anatomical region, the share of places with room for a camera that lie in what was found, nostrils apart."""
    distance, of_found = signed_distance(truth, _PLACES_MM), lumen_distance(found)
    places = distance.origin_mm + distance.spacing_mm * np.argwhere(distance.values_mm > _ROOM_MM)
    places = places[np.linalg.norm(places[:, None] - but_near_mm, axis=-1).min(axis=1) > _OPEN_MM]
    regions = truth.region_set("anatomical")
    label, inside = regions.label(places), of_found(places) > 0
    return {name: float(inside[label == k].mean()) for k, name in enumerate(regions.names) if (label == k).any()}


def apart_mm(
    one: Anatomy, other: Anatomy, but_near_mm: Float[np.ndarray, "k 3"] | None = None
) -> Float[np.ndarray, "n"]:
    """How far the vertices of either surface lie from the other surface; those near some points are left out."""
    found = []
    for from_, to in ((one, other), (other, one)):
        points = from_.vertices_mm
        if but_near_mm is not None:
            near = np.linalg.norm(points[:, None] - but_near_mm, axis=-1).min(axis=1) < _OPEN_MM
            points = points[~near]
        found.append(index_triangles(to.vertices_mm, to.faces).closest(points).distance_mm)
    return np.concatenate(found)


def dice(one: Bool[np.ndarray, "*n"], other: Bool[np.ndarray, "*n"]) -> float:
    """Twice what two masks share over what both have (L. Dice 1945)."""
    return 2 * float((one & other).sum()) / max(float(one.sum() + other.sum()), 1.0)


def on_voxels(airway: Airway, volume: Volume) -> UInt8[np.ndarray, "ni nj nk"]:
    """The label of an airway at each voxel of the scan that it was found in."""
    voxels = np.stack(np.meshgrid(*[np.arange(n) for n in volume.shape], indexing="ij"), -1)
    block = airway.block
    index = np.rint((volume.points_mm(voxels) - block.origin_mm) / block.step_mm).astype(np.int64)
    inside = ((index >= 0) & (index < airway.labels.shape)).all(axis=-1)
    found = np.zeros(volume.shape, np.uint8)
    found[inside] = airway.labels[tuple(index[inside].T)]
    return found


def _of_trips(trips: Sequence[Trip], refused: int) -> list[Figure]:
    n = len(trips)
    base = "anatomy.roundtrip"
    off = np.concatenate([trip.off_mm for trip in trips]) if trips else np.zeros(0)
    marks = np.array([[trip.landmarks_mm[name] for name in _POINTS] for trip in trips])
    per_trip = np.array([trip.off_mm.mean() for trip in trips])
    return [
        Figure(f"{base}.refused", float(refused), "noses", n + refused, "lower", 0.0),
        Figure(f"{base}.surface_mm", _mean(per_trip), "mm", n, "lower", 0.25, _interval(per_trip)),
        Figure(f"{base}.surface_p95_mm", float(np.percentile(off, 95)) if n else None, "mm", n, "lower", 0.8),
        Figure(f"{base}.landmarks_mm", float(marks.mean()) if n else None, "mm", marks.size, "lower", 2.0),
        Figure(f"{base}.landmarks_worst_mm", float(marks.max()) if n else None, "mm", marks.size, "lower"),
        Figure(f"{base}.landmarks_within_2_mm", float((marks <= 2).mean()) if n else None, "1", marks.size, "higher"),
        *(
            Figure(
                f"{base}.{name.replace(' ', '_')}_mm",
                _mean(trip.landmarks_mm[name] for trip in trips),
                "mm",
                n,
                "lower",
            )
            for name in (*_POINTS, *_ON_WALLS)
        ),
        Figure(f"{base}.kept", _mean(share for trip in trips for share in trip.kept.values()), "1", n, "higher"),
        Figure(
            f"{base}.kept_worst_region",
            min((share for trip in trips for share in trip.kept.values()), default=None),
            "1",
            n,
            "higher",
        ),
        *_of_regions([trip.regions for trip in trips if trip.regions is not None]),
        Figure(f"{base}.genus_most", float(max(trip.genus for trip in trips)) if n else None, "handles", n, "lower"),
    ]


def _of_regions(found: Sequence[Right]) -> list[Figure]:
    off_borders, everywhere = (_mean(one.off_borders for one in found), _mean(one.everywhere for one in found))
    base, n = "anatomy.roundtrip.region_accuracy", len(found)
    return [
        Figure(base, off_borders, "1", n, "higher", 0.95),
        Figure(f"{base}_with_borders", everywhere, "1", n, "higher"),
    ]


def _mean(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.mean(listed)) if listed else None


def _interval(per_trip: Float[np.ndarray, "n"]) -> tuple[float, float] | None:
    """95 % of the means over resampled trips."""
    if len(per_trip) < 2:
        return None
    drawn = np.random.default_rng(0).integers(0, len(per_trip), (_RESAMPLED, len(per_trip)))
    low, high = np.percentile(per_trip[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def _of_labelled(scans: Path | None) -> list[Figure]:
    """The scan with expert labels: Dice of all and of either side, and the distance between the surfaces."""
    values: dict[str, float] = {}
    if scans is not None and (scans / LABELLED).is_file() and (scans / LABELS).is_file():
        values = _against_experts(scans / LABELLED, scans / LABELS)
    base, n = "anatomy.p001", 1 if values else 0
    goals = {"dice": 0.86, "right_dice": 0.83, "left_dice": 0.83}
    figures = [Figure(f"{base}.{name}", values.get(name), "1", n, "higher", goal) for name, goal in goals.items()]
    others = ("sinuses_left_out", *(f"{side}_maxillary_dice" for side in _SINUSES))
    figures += [Figure(f"{base}.{name}", values.get(name), "1", n, "higher") for name in others]
    return [*figures, Figure(f"{base}.surface_mm", values.get("surface_mm"), "mm", n, "lower", 0.5)]


def _against_experts(scan: Path, labels: Path) -> dict[str, float]:
    volume = read_scan(scan).volume
    expert, _ = nrrd.read(str(labels))
    airway = segment_airway(volume)
    found, cavities = on_voxels(airway, volume), expert >= min(label for _, label in EXPERT.values())
    made = anatomy_of_airway(airway, "found", "a real CT").anatomy
    values = {
        "sinuses_left_out": 1 - float(np.isin(found[np.isin(expert, tuple(_SINUSES.values()))], NOSE).mean()),
        "dice": dice(np.isin(found, NOSE), cavities),
        "surface_mm": float(apart_mm(made, _surface_of(cavities, volume)).mean()),
    }
    sides = {f"{side}_dice": dice(found == ours, expert == theirs) for side, (ours, theirs) in EXPERT.items()}
    maxillary = {
        f"{side}_maxillary_dice": dice(found == 1 + SEGMENTS.index(f"{side} maxillary sinus"), expert == theirs)
        for side, theirs in _SINUSES.items()
    }
    return values | sides | maxillary


def _surface_of(mask: Bool[np.ndarray, "ni nj nk"], volume: Volume) -> Anatomy:
    """Half-way between the voxels in a mask and those beside it."""
    padded = np.pad(np.where(mask, 1.0, -1.0), 1, constant_values=-1.0)
    nodes, faces = surface(padded, np.full(3, -1.0), 1.0)
    return Anatomy(volume.points_mm(nodes), faces, LPS, "expert labels", "a mask")


def _of_times(request: BenchRequest) -> list[Figure]:
    """How long `naris anatomy from-ct` takes, in a process of its own: a real head, and a large simulated CT."""
    head = large = None
    if not request.quick:
        with tempfile.TemporaryDirectory(prefix="naris-bench-anatomy-", dir=request.work) as folder:
            if request.scans is not None and (request.scans / HEAD).is_file():
                head = _timed(request.scans / HEAD, Path(folder) / "head")
            write_nrrd(_large(), Path(folder) / "large.nrrd")
            large = _timed(Path(folder) / "large.nrrd", Path(folder) / "large")
    return [
        Figure("anatomy.ct_head.seconds", head and head[0], "s", int(head is not None), "lower", 60.0),
        Figure("anatomy.large_ct.seconds", large and large[0], "s", int(large is not None), "lower", 180.0),
        Figure("anatomy.large_ct.peak_gb", large and large[1], "GB", int(large is not None), "lower", 6.0),
    ]


def _large() -> Volume:
    """The CT of the built-in nose with its edges repeated outwards to `LARGE` voxels."""
    scan = virtual_ct(built_in_nose(), SCANNER)
    before = [(want - have) // 2 for want, have in zip(LARGE, scan.shape, strict=True)]
    pads = [(low, want - have - low) for low, want, have in zip(before, LARGE, scan.shape, strict=True)]
    matrix = scan.frame_T_index.copy()
    matrix[:3, 3] = scan.points_mm(-np.array(before, dtype=np.float64))
    return Volume(np.pad(scan.hu, pads, mode="edge"), matrix)


def _timed(scan: Path, out: Path) -> tuple[float, float] | None:
    """Wall seconds of `naris anatomy from-ct` and the most memory that it took, in GB; None if it made no anatomy."""
    words = [sys.executable, "-m", "naris", "anatomy", "from-ct", str(scan), "-o", str(out), "--quiet"]
    begun = time.perf_counter()
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(words, stdout=said)
        _, status, used = os.wait4(child.pid, 0)
        seconds, child.returncode = time.perf_counter() - begun, os.waitstatus_to_exitcode(status)
        if child.returncode:
            said.seek(0)
            _LOG.warning("no anatomy from %s: %s", scan.name, said.read().strip() or f"status {child.returncode}")
            return None
    return seconds, used.ru_maxrss * 1024 / 1e9


def _inputs(scans: Path | None) -> dict[str, str]:
    told = {"round trips": f"built-in noses of drawn parameters, {SCANNER}"}
    for path in (LABELLED, LABELS, HEAD):
        if scans is not None and (scans / path).is_file():
            told[path.name] = f"SHA-256 {file_digest(scans / path)}"
    return told
