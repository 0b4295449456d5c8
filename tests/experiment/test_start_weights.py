"""The weights that ship with naris are those that its command makes, and fit the demo's network."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.provenance import file_digest, plain
from naris.dataset.layout import RegionLabels
from naris.dataset.stream import SeveralStreams, view_stream
from naris.experiment.start_weights import (
    NOSES,
    REGIONS,
    SEED,
    START_WEIGHTS,
    STEPS,
    knows,
    make_start_weights,
    noses_stream,
    start_config,
    start_for,
)
from naris.model.checkpoint import load_checkpoint
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import TRAVEL
from naris.train import COMPACT_DEMO
from tests import simulated_head
from tests.winding_tube import SLABS, winding_tube

CARD = Path(__file__).parents[2] / "docs" / "start_weights.md"
MOST_BYTES = 30e6


def test_the_weights_were_made_as_the_command_makes_them() -> None:
    start = load_checkpoint(START_WEIGHTS)
    settings = {"frozen": 0, **start.training["settings"]}  # they are older than that setting
    assert plain(settings) == plain(start_config(STEPS, SEED))
    assert start.training["steps"] == STEPS
    assert plain(start.config) == plain(COMPACT_DEMO.network)
    assert START_WEIGHTS.stat().st_size < MOST_BYTES


def test_the_card_tells_of_these_weights() -> None:
    card = CARD.read_text(encoding="utf-8")
    assert f"| SHA-256 | {file_digest(START_WEIGHTS)} |" in card
    assert re.search(rf"\| noses, steps, pictures \| {NOSES}, {STEPS:,}, [\d,]+ \|", card)
    assert len(re.findall(r"\| accuracy, `\w+` \| [\d.]+ % ", card)) == 3


def test_small_ones_are_made(tmp_path: Path) -> None:
    tube = winding_tube()
    slabs = replace(SLABS, name=REGIONS)
    camera = Intrinsics.from_vertical_fov(96, 96, 45.0)
    stream = view_stream(Scene(tube), slabs, TRAVEL, TRAINING_APPEARANCE, camera, 7)
    run = make_start_weights(tmp_path / "a", SeveralStreams((stream, replace(stream, seed=8))), steps=2, seed=7)
    assert run.steps == 2
    assert load_checkpoint(run.checkpoint).subject.regions.name == REGIONS


def test_in_another_frame_they_keep_what_they_see_and_learn_where_it_lies() -> None:
    tube = winding_tube().with_(frame="mean", regions={}, passages=winding_tube().passages)
    names = load_checkpoint(START_WEIGHTS).subject.regions.names
    slabs = replace(SLABS, names=names, frame="mean")
    assert knows(slabs)
    assert not knows(SLABS)
    stream = view_stream(Scene(tube), slabs, TRAVEL, TRAINING_APPEARANCE, Intrinsics.from_vertical_fov(8, 8, 45.0), 7)
    here, there = load_checkpoint(START_WEIGHTS), start_for(stream)
    assert there.subject.frame == tube.frame != here.subject.frame
    assert there.subject.regions.digest == RegionLabels.of(slabs).digest
    changed = {name for name in here.weights if not np.array_equal(here.weights[name], there.weights[name])}
    assert changed == {"position_mean_mm", "position_scale_mm"}
    places = stream.batch(1, 256).anatomy_T_camera.position_mm
    np.testing.assert_allclose(there.weights["position_mean_mm"], places.mean(axis=0), atol=2.0)
    np.testing.assert_allclose(there.weights["position_scale_mm"], places.std(axis=0), rtol=0.2, atol=0.3)


@pytest.mark.long
def test_the_noses_differ_from_the_built_in_one(nose: Anatomy) -> None:
    stream = noses_stream(1, 7, 32)
    assert stream.anatomy.digest != nose.digest
    assert stream.batch(0, 4).images.shape == (4, 32, 32, 3)


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return simulated_head.nose()
