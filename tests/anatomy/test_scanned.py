"""From a scan whose truth is known to an anatomy, and how far that is from the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from naris.airway.block import Block
from naris.airway.segment import ATTACHED, LEFT, NASOPHARYNX, RIGHT, Airway
from naris.anatomy.checks import check_surface
from naris.anatomy.crossings import crossings
from naris.anatomy.distance import signed_distance
from naris.anatomy.scanned import MOST_MOVED_MM, ScannedAnatomy, anatomy_of_airway
from naris.core.anatomy import Anatomy
from tests import simulated_head

OPEN_BELOW_MM = -20.0
"""Below lie the nostrils of the built-in nose, which in a scan are open to the room."""


@pytest.fixture
def nose() -> Anatomy:
    return simulated_head.nose()


@pytest.fixture(scope="module")
def made() -> ScannedAnatomy:
    return simulated_head.found()


def test_the_surface_lies_on_that_of_the_truth(nose: Anatomy, made: ScannedAnatomy) -> None:
    """From the surface to the truth, and back to the nearest vertices, which lie 0.5 mm apart."""
    found, true = (points[points[:, 2] > OPEN_BELOW_MM] for points in (made.anatomy.vertices_mm, nose.vertices_mm))
    off = np.abs(signed_distance(nose)(found))
    assert off.mean() < 0.08
    assert np.percentile(off, 95) < 0.2
    missed, _ = cKDTree(made.anatomy.vertices_mm).query(true)
    assert missed.mean() < 0.25
    assert np.percentile(missed, 99) < 0.8


def test_it_is_closed_in_one_piece_wound_outwards_and_without_handles(nose: Anatomy, made: ScannedAnatomy) -> None:
    report = check_surface(made.anatomy.vertices_mm, made.anatomy.faces)
    assert (report.closed, report.pieces, report.genus) == (True, 1, 0)
    assert made.genus == 0
    truth = check_surface(nose.vertices_mm, nose.faces).volume_ml
    assert report.volume_ml == pytest.approx(truth, rel=0.05)


def test_smoothing_moves_no_vertex_further_than_promised(made: ScannedAnatomy) -> None:
    assert 0.02 < made.moved_mm.mean() < made.moved_mm.max() <= MOST_MOVED_MM + 1e-9


def test_passages_lead_from_either_nostril_to_the_back(made: ScannedAnatomy) -> None:
    for side in ("left", "right"):
        way = made.anatomy.passage(f"{side}.main")
        assert np.linalg.norm(way.points_mm[0] - made.anatomy.landmarks_mm[f"{side}.nostril"]) < 6
        assert np.linalg.norm(way.points_mm[-1] - made.anatomy.landmarks_mm["nasopharynx"]) < 6
        assert way.clearance_mm.min() > 0.3


def test_what_opens_into_the_nose_is_kept_when_asked() -> None:
    """A straight passage along y with a cell above it."""
    labels = np.zeros((24, 80, 40), dtype=np.uint8)
    labels[6:18, 4:60, 6:18] = LEFT
    labels[6:18, 60:76, 6:18] = NASOPHARYNX
    labels[8:16, 20:40, 18:34] = ATTACHED
    block = Block(np.zeros(labels.shape, np.float32), np.zeros(3), 0.5)
    level = np.where(labels > 0, 300.0, -300.0).astype(np.float32)
    ends = {f"{side}.{name}": np.array([6.0 + x, y, 6.0]) for side, x in (("left", 1), ("right", -1))
            for name, y in (("nostril", 3.0), ("choana", 30.0))}  # fmt: skip
    landmarks = {**ends, "nasopharynx": np.array([6.0, 34.0, 6.0])}
    airway = Airway(labels, block, level, landmarks)
    volumes = [
        check_surface(one.anatomy.vertices_mm, one.anatomy.faces).volume_ml
        for one in (anatomy_of_airway(airway, "a", "a test"), anatomy_of_airway(airway, "b", "a test", attached=True))
    ]
    cell_ml = float((labels == ATTACHED).sum()) * block.step_mm**3 / 1000
    assert volumes[1] - volumes[0] == pytest.approx(cell_ml, rel=0.1)
    assert volumes[0] == pytest.approx(
        float(np.isin(labels, (LEFT, NASOPHARYNX)).sum()) * block.step_mm**3 / 1000, rel=0.15
    )


@pytest.mark.parametrize(("hu", "told"), [(-450.0, "faint septum"), (-1000.0, "open septum")])
def test_no_passage_leads_through_a_faint_septum(hu: float, told: str) -> None:
    """Two sides that touch above over 8×3 mm, in air that is grey from a septum thinner than a voxel, or clear."""
    labels = np.zeros((40, 80, 40), dtype=np.uint8)
    labels[4:18, 4:60, 6:32], labels[22:36, 4:60, 6:32] = RIGHT, LEFT
    labels[18:20, 22:38, 24:30], labels[20:22, 22:38, 24:30] = RIGHT, LEFT
    labels[4:36, 60:76, 6:32] = NASOPHARYNX
    values = np.full(labels.shape, -1000, np.float32)
    values[18:22, 22:38, 24:30] = hu
    ends = {f"{side}.{name}": np.array([x, y, 9.0]) for side, x in (("left", 14.5), ("right", 5.5))
            for name, y in (("nostril", 3.0), ("choana", 30.0))}  # fmt: skip
    landmarks = {**ends, "nasopharynx": np.array([10.0, 34.0, 9.0])}
    level = np.where(labels > 0, 300.0, -300.0).astype(np.float32)
    made = anatomy_of_airway(Airway(labels, Block(values, np.zeros(3), 0.5), level, landmarks), "a", "a test")
    assert [finding.code for finding in made.findings] == [told]
    assert made.genus == (told == "open septum")


def test_no_face_crosses_another(made: ScannedAnatomy) -> None:
    assert len(crossings(made.anatomy.vertices_mm, made.anatomy.faces)) == 0
