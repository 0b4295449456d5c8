"""A shape model of a family of tubes that is known: its mean, its one mode, what is drawn, and what is on disk."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.crossings import crossings
from naris.anatomy.shape_model import (
    DESCRIPTION,
    MODES,
    ShapeModel,
    build_shape_model,
    load_shape_model,
    save_shape_model,
)
from naris.anatomy.transfer import virtual_references
from naris.core.anatomy import Anatomy
from naris.errors import InputError
from tests import simulated_head
from tests.anatomy.test_correspondence import marked_tube, moved
from tests.winding_tube import RADIUS_MM


def wide(scale: float) -> Anatomy:
    """The tube, wider across x, turned in its scanner and far away."""
    turn = np.array([[np.cos(0.1), -np.sin(0.1), 0], [np.sin(0.1), np.cos(0.1), 0], [0, 0, 1.0]])
    return moved(marked_tube(), lambda points: points * [scale, 1, 1] @ turn.T + [30.0, -20, 5])


@pytest.fixture(scope="module")
def model() -> ShapeModel:
    return build_shape_model(marked_tube(), [wide(scale) for scale in (0.7, 0.85, 1.0, 1.15, 1.3)])


def test_one_way_to_differ_is_one_mode(model: ShapeModel) -> None:
    assert model.patients == 5
    assert model.share[0] > 0.85
    assert model.residual_mm < 0.5
    middle = np.ptp(model.mean.vertices_mm[:, 2])
    assert middle == pytest.approx(np.ptp(marked_tube().vertices_mm[:, 2]), rel=0.03)
    # At one standard deviation (0.24 of the width) the tube is that much wider across x, and no longer.
    moved_mm = np.abs(model.modes_mm[0]).max(axis=0)
    assert moved_mm[0] == pytest.approx(0.24 * (RADIUS_MM + 2), rel=0.35)
    assert moved_mm[1] < 0.4 * moved_mm[0]


def test_patients_are_of_the_family_and_the_same_again(model: ShapeModel) -> None:
    first, again, other = model.patient(3, 0), model.patient(3, 0), model.patient(3, 1)
    assert first.digest == again.digest != other.digest
    assert np.array_equal(first.faces, marked_tube().faces)
    assert first.passages[0].clearance_mm.min() > 2
    assert set(first.landmarks_mm) == set(marked_tube().landmarks_mm)
    assert "shape model of 5 patients" in first.source


@pytest.mark.long
def test_some_noses_drawn_do_not_cross_themselves() -> None:
    model = build_shape_model(simulated_head.nose(), list(virtual_references(3)))
    for number in range(3):
        nose = model.patient(0, number)
        assert len(crossings(nose.vertices_mm, nose.faces)) == 0


def test_a_draw_that_crosses_itself_is_passed_over(model: ShapeModel) -> None:
    """A mode that slides a patch of the wall over its neighbours: what is drawn is near the mean."""
    at = model.mean.vertices_mm
    patch = np.linalg.norm(at - at[len(at) // 2], axis=1) < 2.0
    mode = (8.0 * patch[:, None] * np.array([0.0, 1.0, 0.0])).astype(np.float32)
    sliding = replace(model, modes_mm=mode[None], share=np.ones(1))
    assert len(crossings(sliding.vertices_mm(np.ones(1)), model.mean.faces)) > 0
    drawn = [sliding.patient(0, number) for number in range(6)]
    assert all(len(crossings(one.vertices_mm, one.faces)) == 0 for one in drawn)
    assert any("draw" in one.source for one in drawn)


def test_a_model_on_disk_is_the_same(model: ShapeModel, tmp_path: Path) -> None:
    save_shape_model(model, tmp_path / "model")
    read = load_shape_model(tmp_path / "model")
    assert read.mean.digest == model.mean.digest
    assert np.array_equal(read.modes_mm, model.modes_mm)
    assert read.patient(1, 2).digest == model.patient(1, 2).digest
    assert model.curves is not None and read.curves is not None
    for name, values in vars(model.curves).items():
        assert np.array_equal(getattr(read.curves, name), values)


def test_a_model_from_before_there_were_curves_has_none(model: ShapeModel, tmp_path: Path) -> None:
    save_shape_model(model, tmp_path)
    told = json.loads((tmp_path / DESCRIPTION).read_text())
    del told["curves"]
    (tmp_path / DESCRIPTION).write_text(json.dumps({**told, "schema": "naris.shape-model/1"}))
    assert load_shape_model(tmp_path).curves is None


def test_curves_say_that_one_mode_does(model: ShapeModel) -> None:
    curves = model.curves
    assert curves is not None
    assert curves.compactness[1] == pytest.approx(model.share[0])
    assert curves.generalisation_mm[1] < 0.3 * curves.generalisation_mm[0]
    assert 0 < curves.specificity_mm[1] < curves.generalisation_mm[0]


@pytest.mark.parametrize(
    ("file", "content"),
    [
        *((DESCRIPTION, b"{}"), (DESCRIPTION, b"no JSON"), (DESCRIPTION, None)),
        (DESCRIPTION, b"short"),
        *((MODES, b"no archive"), (MODES, None), (MODES, b"flip")),
    ],
)
def test_a_damaged_one_is_refused(model: ShapeModel, tmp_path: Path, file: str, content: bytes | None) -> None:
    save_shape_model(model, tmp_path)
    if content is None:
        (tmp_path / file).unlink()
    elif content == b"short":
        told = json.loads((tmp_path / file).read_text())
        told["curves"]["compactness"].pop()
        (tmp_path / file).write_text(json.dumps(told))
    elif content == b"flip":
        stored = bytearray((tmp_path / file).read_bytes())
        for place in range(len(stored) // 3, len(stored) // 2, 997):
            stored[place] ^= 0xFF
        (tmp_path / file).write_bytes(stored)
    else:
        (tmp_path / file).write_bytes(content)
    with pytest.raises(InputError, match=r"a (whole )?shape model"):
        load_shape_model(tmp_path)


def test_too_few_are_refused() -> None:
    with pytest.raises(InputError, match="3 patients or more"):
        build_shape_model(marked_tube(), [wide(1.1), wide(0.9)])


def test_the_mean_is_of_the_patients_alone() -> None:
    """The reference counts where it is given as one of them, and else only gives its mesh."""
    reference, patients = marked_tube(), [wide(scale) for scale in (1.2, 1.3, 1.4)]
    without, with_it = (build_shape_model(reference, of) for of in (patients, [*patients, reference]))
    assert (without.patients, with_it.patients) == (3, 4)
    widths = [np.ptp(one.mean.vertices_mm[:, 0]) / np.ptp(reference.vertices_mm[:, 0]) for one in (without, with_it)]
    assert widths[0] > 1.2
    assert 4 * widths[1] == pytest.approx(3 * widths[0] + 1, abs=0.03)
