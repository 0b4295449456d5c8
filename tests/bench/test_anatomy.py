"""The benchmark of noses found in CTs: its distances and overlaps on shapes whose answer is known, and a small run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from naris.bench import BenchRequest
from naris.bench.anatomy import (
    LABELLED,
    Trip,
    _of_labelled,
    _of_times,
    _of_trips,
    _surface_of,
    apart_mm,
    compared,
    dice,
    kept,
    measure,
)
from naris.bench.carried import of_transfers, references_of
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume
from naris.errors import ScanError
from tests import simulated_head


def ball(radius_mm: float) -> Anatomy:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_mm)
    return Anatomy(
        np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), "LPS", f"ball of {radius_mm}", "made up"
    )


def test_concentric_balls_lie_apart_by_the_difference_of_their_radii() -> None:
    off = apart_mm(ball(10.0), ball(10.5))
    assert off.mean() == pytest.approx(0.5, abs=0.02)
    assert off.max() < 0.55
    top = np.array([[0.0, 0.0, 10.0]])
    assert len(apart_mm(ball(10.0), ball(10.5), top)) < len(off)


def test_the_overlap_of_masks() -> None:
    one, other = np.zeros(10, bool), np.zeros(10, bool)
    one[:4], other[2:8] = True, True
    assert dice(one, other) == pytest.approx(2 * 2 / 10)
    assert dice(one, one) == 1.0
    assert dice(~one & one, one) == 0.0


def test_the_surface_of_a_mask_lies_where_the_mask_does() -> None:
    """A ball of voxels in a scan with its axes turned and slices twice as far apart."""
    matrix = np.array([[0.0, 0.5, 0, 10], [0.5, 0, 0, 20], [0, 0, 1.0, 30], [0, 0, 0, 1]])
    volume = Volume(np.zeros((60, 60, 30), np.int16), matrix)
    at = volume.points_mm(np.stack(np.meshgrid(*[np.arange(n) for n in volume.shape], indexing="ij"), -1))
    middle = volume.points_mm(np.array([30.0, 30, 15]))
    made = _surface_of(np.linalg.norm(at - middle, axis=-1) < 10, volume)
    np.testing.assert_allclose(np.linalg.norm(made.vertices_mm - middle, axis=1), 10, atol=0.6)


def test_without_scans_their_figures_have_no_value(tmp_path: Path) -> None:
    nothing = BenchRequest(quick=True, scans=tmp_path)
    for figures in (_of_labelled(None), _of_labelled(tmp_path), _of_times(nothing)):
        assert {(figure.value, figure.n) for figure in figures} == {(None, 0)}


def test_refused_noses_are_counted_not_passed_over() -> None:
    figures = {figure.name: figure for figure in _of_trips([], refused=2)}
    assert (figures["anatomy.roundtrip.refused"].value, figures["anatomy.roundtrip.refused"].n) == (2.0, 2)
    assert figures["anatomy.roundtrip.surface_mm"].value is None


def test_a_trip_that_finds_no_nose_stops_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything but the trips themselves, which take most of a minute."""

    def trip(seed: int, number: int, references: object) -> Trip:
        if number == 0:
            raise ScanError("two open nostrils", "one", "give another")
        return Trip(np.full(4, 0.1 * number), {"left.nostril": 1.0 * number}, 0, {"left": 1 - number / 10})

    monkeypatch.setattr("naris.bench.anatomy.round_trip", trip)
    monkeypatch.setattr("naris.bench.anatomy.references_of", lambda request: [])
    monkeypatch.setattr("naris.bench.anatomy.of_transfers", lambda request, references: [])
    monkeypatch.setattr("naris.bench.anatomy.of_samples", lambda request, references: [])
    monkeypatch.setattr("naris.bench.anatomy.QUICK_TRIPS", 3)
    monkeypatch.setattr("naris.bench.anatomy._POINTS", ("left.nostril",))
    monkeypatch.setattr("naris.bench.anatomy._ON_WALLS", ())
    figures = {one.name: one for one in measure(BenchRequest(quick=True)).figures}
    assert (figures["anatomy.roundtrip.refused"].value, figures["anatomy.roundtrip.refused"].n) == (1.0, 3)
    surface_mm = figures["anatomy.roundtrip.surface_mm"]
    assert surface_mm.value == pytest.approx(0.15)
    assert surface_mm.interval == pytest.approx((0.1, 0.2))
    assert figures["anatomy.roundtrip.left.nostril_mm"].value == pytest.approx(1.5)


@pytest.mark.long
def test_a_nose_found_in_its_own_scan_is_near_itself() -> None:
    trip = compared(simulated_head.nose(), simulated_head.airway(), simulated_head.found())
    assert trip.off_mm.mean() < 0.15
    assert max(trip.landmarks_mm.values()) < 5.0
    assert trip.genus == 0
    assert len(trip.kept) == 13
    assert min(trip.kept.values()) > 0.9


@pytest.mark.long
def test_a_region_that_is_lost_is_seen() -> None:
    """The nose without what lies on the left above the inferior meatus: most of two regions, and no other."""
    nose = simulated_head.nose()
    low = nose.vertices_mm.copy()
    lost = (low[:, 0] > 2) & (low[:, 2] > -1)
    low[lost, 2] = -1.0
    shares = kept(nose.with_(vertices_mm=low), nose, np.stack([nose.landmarks_mm["left.nostril"]]))
    assert shares["left superior meatus and olfactory cleft"] < 0.1
    assert shares["right superior meatus and olfactory cleft"] > 0.99


@pytest.mark.long
def test_expert_labels_of_a_real_scan_are_met(shared_data: Path) -> None:
    assert (shared_data / LABELLED).is_file()
    values = {figure.name.removeprefix("anatomy.p001."): figure.value for figure in _of_labelled(shared_data)}
    assert values["dice"] > 0.88
    assert values["right_dice"] > 0.84
    assert values["left_dice"] > 0.83
    assert values["surface_mm"] < 0.6
    assert values["sinuses_left_out"] > 0.98
    assert min(values["right_maxillary_dice"], values["left_maxillary_dice"]) > 0.9


@pytest.mark.long
def test_regions_carried_between_noses() -> None:
    """One target, three references: the very function of the whole benchmark."""
    request = BenchRequest(quick=True)
    figures = {one.name: one for one in of_transfers(request, references_of(request))}
    assert figures["anatomy.transfer.region_accuracy"].value > 0.75
    assert figures["anatomy.transfer.region_accuracy_off_borders"].value > 0.8
