"""The weights that ship with naris are those that its command makes, and fit the demo's network."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from naris.anatomy.builtin import built_in_nose
from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.provenance import file_digest, plain
from naris.dataset.stream import SeveralStreams, view_stream
from naris.experiment.start_weights import (
    NOSES,
    REGIONS,
    SEED,
    START_WEIGHTS,
    STEPS,
    make_start_weights,
    noses_stream,
    start_config,
)
from naris.model.checkpoint import load_checkpoint
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import TRAVEL
from naris.train import COMPACT_DEMO
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


@pytest.mark.slow
def test_the_noses_differ_from_the_built_in_one(nose: Anatomy) -> None:
    stream = noses_stream(1, 7, 32)
    assert stream.anatomy.digest != nose.digest
    assert stream.batch(0, 4).images.shape == (4, 32, 32, 3)


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return built_in_nose()
