"""The weights of the depth network that ships with naris: in which noses, under which views they learn.

`python docs/make_depth_weights.py` makes them anew; `docs/depth_network.md` says what they are and how good.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from naris.anatomy.builtin.variants import VARIANTS
from naris.anatomy.builtin.variation import virtual_patient
from naris.core.camera import Intrinsics
from naris.core.cores import cores
from naris.core.progress import SILENT, Progress
from naris.dataset.stream import ViewStream, view_stream
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import ANYWHERE, TRAVEL, ViewDistribution

NOSES, SEED = 32, 5_000_000
EVERY_VARIANT = 4
ALL_ROUND = ViewDistribution(
    "all round",
    clearance_mm=1.0,
    tilt_sd_deg=None,
    tilt_max_deg=90.0,
    roll_sd_deg=25.0,
    median_depth_mm=3.0,
    balanced=True,
)
"""Up to 90° off the way, where something is 3 mm or more ahead."""

VIEWS = (ALL_ROUND, TRAVEL, ALL_ROUND, ANYWHERE)
"""Of the noses in turn."""


def depth_streams(count: int, seed: int, size_px: int, progress: Progress = SILENT) -> list[ViewStream]:
    """Views in virtual patients, every fourth with a variant of the anatomy.

    Raises:
        RegionError: if a region of one has no room for a camera.
    """
    camera, kinds = Intrinsics.from_vertical_fov(size_px, size_px, 60.0), sorted(VARIANTS)

    def stream(number: int) -> ViewStream:
        turn, place = divmod(number, EVERY_VARIANT)
        variant = kinds[turn % len(kinds)] if place == EVERY_VARIANT - 2 else None
        nose = virtual_patient(seed, number, variant)
        views = VIEWS[number % len(VIEWS)]
        return view_stream(Scene(nose), nose.region_set(), views, TRAINING_APPEARANCE, camera, seed + number)

    with ThreadPoolExecutor(cores()) as pool, progress.task("noses", count) as advance:
        parts = []
        for part in pool.map(stream, range(count)):
            parts.append(part)
            advance(1)
    return parts
