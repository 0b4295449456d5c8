"""Simulated endoscopy on disk: images with poses, depth, regions and where all of it came from.

Sample i depends on the plan and i alone (its random numbers are `default_rng([seed, i])`), so any number of workers
makes the same bytes, and a run that was stopped, killed or ran out of disk goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import naris
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.atomic import PART, to_json, write_bytes, write_json, write_text
from naris.core.camera import Intrinsics
from naris.core.cores import cores
from naris.core.progress import SILENT, Progress
from naris.core.provenance import digest, plain
from naris.dataset.layout import (
    ABOUT,
    DEPTH_SCALE_MM,
    DEPTHS,
    IMAGES,
    SAMPLES,
    SCHEMA,
    RegionLabels,
    depth_name,
    depth_to_steps,
    image_name,
    intrinsics_to_json,
)
from naris.dataset.pictures import encode_depth, encode_rgb, is_whole
from naris.dataset.read import Dataset
from naris.errors import ConfigurationChanged, DatasetError
from naris.render.appearance import Appearance, AppearanceDistribution
from naris.render.scene import Channel, Scene, render
from naris.render.viewpoints import Viewpoints

_log = logging.getLogger(__name__)
_CHUNK = 8


@dataclass(frozen=True, eq=False)
class Simulation:
    """Everything that decides the bytes of a data set.

    Attributes:
        anatomy: what is seen.
        regions: which region set labels the views.
        views: N viewpoints.
        intrinsics: of every image.
        appearance: of every image, or what to draw each image's from.
        seed: of appearances and sensor noise.
        depth: whether to keep depth.
        views_from: how the views were chosen, for the record (dataclasses, numbers, text).
    """

    anatomy: Anatomy
    regions: RegionSet
    views: Viewpoints
    intrinsics: Intrinsics
    appearance: Appearance | AppearanceDistribution
    seed: int = 0
    depth: bool = True
    views_from: dict[str, Any] = field(default_factory=dict)

    def about(self, engine: str) -> dict[str, Any]:
        """What `dataset.json` says: no times, paths or names of machines or people."""
        views = hashlib.sha256(self.views.anatomy_T_camera.matrix.tobytes()).hexdigest()
        anatomy = self.anatomy
        return {
            "schema": SCHEMA,
            "naris": naris.__version__,
            "engine": engine,
            "count": len(self.views),
            "seed": self.seed,
            "anatomy": {
                "name": anatomy.name,
                "frame": anatomy.frame,
                "digest": anatomy.digest,
                "source": anatomy.source,
            },
            "regions": RegionLabels.of(self.regions).to_json(),
            "intrinsics": intrinsics_to_json(self.intrinsics),
            "depth": {"scale_mm": DEPTH_SCALE_MM} if self.depth else None,
            "views": {**plain(self.views_from), "poses_sha256": views},
            "appearance": {"kind": type(self.appearance).__name__, **plain(self.appearance)},
        }


def simulate(
    simulation: Simulation,
    out: Path,
    *,
    scene: Scene | None = None,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> Dataset:
    """Make a data set in the folder `out`, or what is still missing of it.

    Args:
        simulation: what to make.
        out: a folder that is new, empty, or holds (part of) this very data set.
        scene: of the same anatomy, if there is one already.
        workers: threads; one a core when None. The bytes are the same for any number.
        progress: told of every image.

    Raises:
        ConfigurationChanged: if `out` holds a data set made with other settings; nothing is touched.
        DatasetError: if `out` holds something else, or the scene is of another anatomy.
        DiskFull: if there is no room; every file that is there is whole, and the same call goes on.
    """
    scene = scene or Scene(simulation.anatomy)
    if scene.anatomy.digest != simulation.anatomy.digest:
        raise DatasetError(f"a scene of {simulation.anatomy.name}", f"one of {scene.anatomy.name}", "leave it out")
    about = simulation.about(scene.engine)
    _claim(out, about)
    missing = [i for i in range(len(simulation.views)) if not _is_done(out, i, simulation.depth)]
    if len(missing) < len(simulation.views):
        there = len(simulation.views) - len(missing)
        _log.info("%d of %d pictures are in %s already", there, len(simulation.views), out)
    chunks = [missing[i : i + _CHUNK] for i in range(0, len(missing), _CHUNK)]
    with progress.task("images", len(simulation.views)) as advance:
        advance(len(simulation.views) - len(missing))
        for done in _each_done(simulation, scene, out, chunks, workers or cores()):
            advance(done)
    rows = (to_json(_row(simulation, i), indent=None) for i in range(len(simulation.views)))
    text = "".join(f"{row}\n" for row in rows)
    if not (out / SAMPLES).is_file() or (out / SAMPLES).read_text(encoding="utf-8") != text:
        write_text(out / SAMPLES, text)
    return Dataset.open(out)


def _claim(out: Path, about: dict[str, Any]) -> None:
    """Make the folder this data set's, or see that it is."""
    if out.exists() and not out.is_dir():
        raise DatasetError(f"a folder to write to at {out.name}", "a file", "give another folder")
    if (out / ABOUT).is_file():
        try:
            old = json.loads((out / ABOUT).read_text(encoding="utf-8"))
        except ValueError as error:
            raise DatasetError(f"JSON in {ABOUT} of {out.name}", "something else", "give another folder") from error
        if not isinstance(old, dict) or digest(old) != digest(json.loads(to_json(about))):
            changed = _differences(old, json.loads(to_json(about))) if isinstance(old, dict) else ["everything"]
            raise ConfigurationChanged(
                f"{out.name} to be made with the same settings",
                f"others in {', '.join(changed)}",
                "give another folder, or remove this one if you no longer need it",
            )
    elif out.exists() and any(not path.name.startswith(".") for path in out.iterdir()):
        raise DatasetError(
            f"a new or empty folder, or one with {ABOUT}", f"other files in {out.name}", "give another folder"
        )
    else:
        write_json(out / ABOUT, about)
    for folder in (out, out / IMAGES, out / DEPTHS):
        for leftover in folder.glob(f".*{PART}*"):
            leftover.unlink(missing_ok=True)


_CALLED = {
    "anatomy": "the anatomy",
    "appearance": "the appearance",
    "count": "the number of pictures",
    "depth": "whether depth is kept",
    "engine": "the renderer",
    "intrinsics": "the camera",
    "naris": "the version of naris",
    "regions": "the region set",
    "schema": "the format",
    "seed": "the seed",
    "views": "the choice of views",
}
_UNTOLD = ("digest", "kind", "poses_sha256", "source")


def _differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """The settings that differ, as people call them, with what differs inside them where that says more."""
    names = []
    for key in sorted({*old, *new}):
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            inner = [name for name in sorted({*a, *b}) if digest(a.get(name)) != digest(b.get(name))]
            told = [name.replace("_", " ") for name in inner if name not in _UNTOLD]
            if inner:
                names.append(_CALLED.get(key, key) + (f" ({', '.join(told)})" if told else ""))
        elif digest(a) != digest(b):
            names.append(_CALLED.get(key, key))
    return names


def _is_done(out: Path, index: int, depth: bool) -> bool:
    return is_whole(out / image_name(index)) and (not depth or is_whole(out / depth_name(index)))


def _each_done(
    simulation: Simulation, scene: Scene, out: Path, chunks: Sequence[list[int]], workers: int
) -> Iterator[int]:
    """Make the chunks on threads and yield how many samples each had; the first error stops the rest."""
    waiting: set[Future[int]] = set()
    with ThreadPoolExecutor(workers, thread_name_prefix="simulate") as pool:
        try:
            for chunk in chunks:
                waiting.add(pool.submit(_make, simulation, scene, out, chunk))
                if len(waiting) >= 2 * workers:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield sum(future.result() for future in done)
            yield sum(future.result() for future in waiting)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _make(simulation: Simulation, scene: Scene, out: Path, chunk: list[int]) -> int:
    """Render and write a few samples."""
    chosen = [_chance(simulation, index) for index in chunk]
    want: tuple[Channel, ...] = ("rgb", "depth") if simulation.depth else ("rgb",)
    rendering = render(
        scene,
        simulation.views.anatomy_T_camera[np.array(chunk)],
        simulation.intrinsics,
        [appearance for appearance, _ in chosen],
        want=want,
        seeds=np.array([seed for _, seed in chosen]),
        threads=1,
    )
    for k, index in enumerate(chunk):
        if rendering.depth_mm is not None:
            write_bytes(out / depth_name(index), encode_depth(depth_to_steps(rendering.depth_mm[k])), durable=False)
        if rendering.rgb is not None:
            write_bytes(out / image_name(index), encode_rgb(rendering.rgb[k]), durable=False)
    return len(chunk)


def _chance(simulation: Simulation, index: int) -> tuple[Appearance, int]:
    """The appearance and the seed of the sensor noise of one sample."""
    rng = np.random.default_rng([simulation.seed, index])
    noise_seed = int(rng.integers(2**31))
    if isinstance(simulation.appearance, AppearanceDistribution):
        return simulation.appearance.sample(rng), noise_seed
    return simulation.appearance, noise_seed


def _row(simulation: Simulation, index: int) -> dict[str, Any]:
    views = simulation.views
    return {
        "index": index,
        "image": image_name(index),
        "depth": depth_name(index) if simulation.depth else None,
        "anatomy_T_camera": views.anatomy_T_camera.matrix[index].tolist(),
        "region": int(views.region[index]),
        "trajectory": int(views.trajectory[index]),
        "position": int(views.position[index]),
        "noise_seed": _chance(simulation, index)[1],
    }
