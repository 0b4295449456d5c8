"""How right regions are that were carried to another nose: virtual patients, whose own regions are known."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import virtual_patient
from naris.anatomy.distance import signed_distance
from naris.anatomy.shape_model import build_shape_model
from naris.anatomy.transfer import Transfer, transfer_regions, virtual_references
from naris.bench import BenchRequest
from naris.bench.result import Figure
from naris.core.anatomy import NOWHERE, Anatomy, RegionSet

REFERENCES, QUICK_REFERENCES = 12, 3
TARGETS, QUICK_TARGETS = 10, 1
SAMPLES, QUICK_SAMPLES = 8, 1
MODELLED = 8  # references that the shape model of the samples is built of
_OTHER_SEEDS = 1_000_000  # of the targets, apart from those of the round trips
_ROOM_MM, _BORDER_MM = 1.0, 1.0
_SPACING_MM = 1.0


class Right(NamedTuple):
    """The share of a camera's places whose region was right, of all and of those away from borders, and as expected."""

    everywhere: float
    off_borders: float
    likely: float


def right(found: Transfer, truth: Anatomy) -> Right:
    """Places are the nodes of a grid of 1 mm with 1 mm of room in the true lumen.

    Off borders means that the true region is the same for 1 mm around.
    """
    regions = truth.region_set(found.regions.name)
    distance = signed_distance(truth, _SPACING_MM)
    places = distance.origin_mm + distance.spacing_mm * np.argwhere(distance.values_mm > _ROOM_MM)
    true = regions.label(places)
    places, true = places[true != NOWHERE], true[true != NOWHERE]
    is_right = found.regions.label(places) == true
    return Right(float(is_right.mean()), float(is_right[_off_borders(regions, places)].mean()), found.likely)


def of_transfers(request: BenchRequest, references: Sequence[Anatomy]) -> list[Figure]:
    """To noses of drawn parameters, from the references."""
    done = []
    with request.progress.task("transfers", _count(request, TARGETS, QUICK_TARGETS)) as advance:
        for target in _noses(request, _count(request, TARGETS, QUICK_TARGETS)):
            done.append(right(transfer_regions(target, references), target))
            advance(1)
    n, base = len(done), "anatomy.transfer"
    everywhere, off_borders, likely = (np.array(values) for values in zip(*done, strict=True))
    return [
        Figure(f"{base}.region_accuracy", float(everywhere.mean()), "1", n, "higher", 0.93),
        Figure(f"{base}.region_accuracy_worst", float(everywhere.min()), "1", n, "higher"),
        Figure(f"{base}.region_accuracy_off_borders", float(off_borders.mean()), "1", n, "higher"),
        Figure(f"{base}.likely", float(likely.mean()), "1", n, "higher"),
    ]


def of_samples(request: BenchRequest, references: Sequence[Anatomy]) -> list[Figure]:
    """What a virtual patient costs, with regions, landmarks and passages: from a shape model, and from parameters."""
    count = _count(request, SAMPLES, QUICK_SAMPLES)
    model = build_shape_model(built_in_nose(), references[-MODELLED:], request.progress)
    model.patient(request.seed, count)  # compiles what there is to compile
    from_model, from_parameters = (_cpu_s(draw, request.seed, count) for draw in (model.patient, virtual_patient))
    return [
        Figure("anatomy.sample.cpu_s", from_model, "CPU-s", count, "lower", 2.0),
        Figure("anatomy.sample.parametric_cpu_s", from_parameters, "CPU-s", count, "lower"),
    ]


def _cpu_s(draw: Callable[[int, int], Anatomy], seed: int, count: int) -> float:
    begun = time.process_time()
    for number in range(count):
        draw(seed, number)
    return (time.process_time() - begun) / count


def references_of(request: BenchRequest) -> Sequence[Anatomy]:
    """What regions are carried from."""
    return list(virtual_references(_count(request, REFERENCES, QUICK_REFERENCES)))


def _noses(request: BenchRequest, count: int) -> Iterator[Anatomy]:
    return (virtual_patient(_OTHER_SEEDS + request.seed, number) for number in range(count))


def _count(request: BenchRequest, whole: int, quick: int) -> int:
    return quick if request.quick else whole


def _off_borders(regions: RegionSet, places_mm: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether a place and all around it at the distance of a border are in one region (or in none)."""
    here = regions.label(places_mm)
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    off = np.ones(len(places_mm), dtype=bool)
    for step in steps[np.any(steps != 0, axis=1)]:
        there = regions.label(places_mm + _BORDER_MM * step / np.linalg.norm(step))
        off &= (there == here) | (there == NOWHERE)
    return off
