"""The anatomical regions: all of the air has one, and those touch that touch in a nose."""

from __future__ import annotations

import numpy as np

from naris.anatomy.builtin.regions import ANATOMICAL_NAMES, OF_A_SIDE
from naris.anatomy.distance import signed_distance
from naris.core.anatomy import NOWHERE, Anatomy


def names_that_touch(nose: Anatomy) -> set[frozenset[str]]:
    regions = nose.regions["anatomical"]
    rows, columns = np.nonzero(regions.neighbours)
    return {frozenset((regions.names[i], regions.names[j])) for i, j in zip(rows, columns, strict=True) if i != j}


def test_all_air_has_a_region_and_far_tissue_has_none(nose: Anatomy) -> None:
    regions = nose.regions["anatomical"]
    assert regions.names == ANATOMICAL_NAMES and len(ANATOMICAL_NAMES) == 13
    rng = np.random.default_rng(2)
    points = rng.uniform(*nose.bounds_mm, (8_000, 3))
    clearance = signed_distance(nose, 1.0)(points)
    labels = regions.label(points)
    assert (labels[clearance > 0.3] != NOWHERE).all()
    assert (labels[clearance < -4] == NOWHERE).all()


def test_every_region_has_room_for_a_camera(nose: Anatomy) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(*nose.bounds_mm, (60_000, 3))
    roomy = points[signed_distance(nose, 1.0)(points) > 1.0]
    counts = np.bincount(nose.regions["anatomical"].label(roomy), minlength=len(ANATOMICAL_NAMES))
    volume_ml = counts / len(points) * np.ptp(nose.bounds_mm, axis=0).prod() / 1000
    assert (volume_ml > 0.15).all(), dict(zip(ANATOMICAL_NAMES, volume_ml.round(2), strict=True))


def test_regions_touch_as_in_a_nose(nose: Anatomy) -> None:
    touch = names_that_touch(nose)
    for side in ("left", "right"):
        front_to_back = [f"{side} {part}" for part in OF_A_SIDE]
        vestibule, valve, inferior, middle, superior, posterior = front_to_back
        for pair in ((vestibule, valve), (valve, inferior), (valve, middle), (inferior, middle), (middle, superior),
                     (inferior, posterior), (middle, posterior), (posterior, "nasopharynx")):  # fmt: skip
            assert frozenset(pair) in touch, pair
        for pair in ((vestibule, inferior), (vestibule, posterior), (vestibule, "nasopharynx"), (inferior, superior)):
            assert frozenset(pair) not in touch, pair


def test_landmarks_lie_in_the_regions_of_their_names(nose: Anatomy) -> None:
    regions = nose.regions["anatomical"]
    for side in ("left", "right"):
        for landmark, region in {
            "nostril": "vestibule",
            "valve": "nasal valve and anterior septum",
            "inferior meatus": "inferior meatus",
            "common meatus": "inferior meatus",
            "middle meatus": "middle meatus",
            "superior meatus": "superior meatus and olfactory cleft",
            "olfactory cleft": "superior meatus and olfactory cleft",
            "choana": "posterior cavity and choana",
        }.items():
            label = int(regions.label(nose.landmarks_mm[f"{side}.{landmark}"]))
            assert regions.names[label] == f"{side} {region}", landmark
    assert regions.names[int(regions.label(nose.landmarks_mm["nasopharynx"]))] == "nasopharynx"
