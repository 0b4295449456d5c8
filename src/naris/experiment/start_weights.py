"""The weights that a network on views at will starts from: those of one that has learned its way in many other noses.

`python docs/make_start_weights.py` makes them anew; `docs/start_weights.md` says what they are and how good.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import drawn_parameters
from naris.core.anatomy import RegionSet
from naris.core.camera import Intrinsics
from naris.core.progress import SILENT, Progress
from naris.dataset.layout import RegionLabels
from naris.dataset.stream import SeveralStreams, ViewStream, view_stream
from naris.model.checkpoint import Checkpoint, load_checkpoint
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import TRAVEL, draw_views
from naris.train import COMPACT_AT_WILL, COMPACT_DEMO, Replay, TrainConfig, TrainingRun, train

START_WEIGHTS = Path(__file__).parent / "weights" / "noses.safetensors"
"""The file that ships with naris."""

REGIONS = "paper"
NOSES, STEPS, SEED = 32, 10000, 20181026
FOV_DEG = 45.0
_PLACES = 512
_log = logging.getLogger(__name__)


def knows(regions: RegionSet) -> bool:
    """Whether the weights are of a network for regions of these names."""
    return load_checkpoint(START_WEIGHTS).subject.regions.names == regions.names


def start_for(stream: ViewStream) -> Checkpoint:
    """The weights as those of a network for the nose of a stream, with regions that they know (`knows`).

    What the weights know is where a view lies in a nose, in units of how far views reach along each axis. Where a nose
    lies in its frame, and which frame of the same axes that is (x to the left, y back, z up, as the mean nose's), says
    nothing of that: middle and reach are taken from views of the stream. So are the regions, whose borders here are
    other ones and are to be learned.
    """
    start = load_checkpoint(START_WEIGHTS)
    views = draw_views(stream.scene, stream.bank, _PLACES, np.random.default_rng(stream.seed), stream.avoid)
    places_mm = views.anatomy_T_camera.position_mm
    reach_mm = np.maximum(places_mm.std(axis=0), 1.0)
    units = {"position_mean_mm": places_mm.mean(axis=0), "position_scale_mm": reach_mm}
    weights = {**start.weights, **{name: value.astype(np.float32) for name, value in units.items()}}
    regions = RegionLabels.of(stream.regions)
    return replace(start, weights=weights, subject=replace(start.subject, frame=stream.anatomy.frame, regions=regions))


def noses_stream(count: int, seed: int, size_px: int) -> SeveralStreams:
    """Views in noses of drawn parameters (`naris.anatomy.builtin.variation`), the built-in nose itself not among them.

    Raises:
        RegionError: if a region of one has no room for a camera.
    """
    camera = Intrinsics.from_vertical_fov(size_px, size_px, FOV_DEG)
    parts = []
    for number in range(count):
        nose = built_in_nose(drawn_parameters(np.random.default_rng([seed, number])))
        regions = nose.region_set(REGIONS)
        parts.append(view_stream(Scene(nose), regions, TRAVEL, TRAINING_APPEARANCE, camera, seed + number))
        _log.info("nose %d of %d", number + 1, count)
    return SeveralStreams(tuple(parts))


def start_config(steps: int, seed: int) -> TrainConfig:
    """How the weights are trained."""
    return COMPACT_AT_WILL.lasting(steps=steps).with_(
        name="compact, start weights", network=COMPACT_DEMO.network, seed=seed, replay=Replay(times=4, memory=192)
    )


def make_start_weights(
    out: Path,
    stream: SeveralStreams | None = None,
    *,
    steps: int = STEPS,
    seed: int = SEED,
    progress: Progress = SILENT,
) -> TrainingRun:
    """Train the demo's network in the folder `out`, or go on there; on `NOSES` noses if no stream is given.

    Raises:
        ConfigurationChanged, InputError, DiskFull: as `naris.train.train`.
    """
    stream = stream or noses_stream(NOSES, seed, COMPACT_DEMO.network.input_px)
    return train(stream, start_config(steps, seed), out, progress=progress, task="start weights")
