"""The pictures of an experiment: one training set, and a test set for each split."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from naris.core.anatomy import RegionSet
from naris.core.camera import Intrinsics
from naris.core.progress import Progress
from naris.core.provenance import plain
from naris.dataset.generate import Simulation, simulate
from naris.dataset.read import Dataset
from naris.dataset.splits import SplitSizes, make_splits
from naris.render.appearance import Appearance, AppearanceDistribution
from naris.render.scene import Scene
from naris.render.viewpoints import Viewpoints

TRAIN = "train"
PUBLISHED, TRAJECTORY, TRAJECTORY_TEXTURE = "published", "trajectory", "trajectory_texture"
PAPER_CAMERA = Intrinsics.from_vertical_fov(300, 300, 45.0)
"""300×300 pixels, vertical field of view 45°, as in Sinha et al. 2018."""

_SEED_OF = {TRAIN: 1, PUBLISHED: 2, TRAJECTORY: 3, TRAJECTORY_TEXTURE: 4}


@dataclass(frozen=True, eq=False)
class Setting:
    """What is looked at, and how.

    Attributes:
        scene: of the anatomy.
        regions: to be told apart.
        seen: the look of the training pictures, and of the splits `published` and `trajectory`.
        unseen: the looks of the split `trajectory_texture`.
        sizes: how many positions and views.
        seed: of views and looks.
        intrinsics: of every picture.
    """

    scene: Scene
    regions: RegionSet
    seen: Appearance | AppearanceDistribution
    unseen: AppearanceDistribution
    sizes: SplitSizes = SplitSizes()
    seed: int = 0
    intrinsics: Intrinsics = PAPER_CAMERA


@dataclass(frozen=True, eq=False)
class Sets:
    """The pictures of an experiment, on disk.

    Attributes:
        train: the training pictures.
        tests: by split, `published`, `trajectory`, `trajectory_texture`.
    """

    train: Dataset
    tests: Mapping[str, Dataset]


def make_sets(setting: Setting, out: Path, progress: Progress) -> Sets:
    """Make (or go on making) the pictures in the folders `train`, `published`, … of `out`.

    The views are drawn once from the seed; `trajectory` and `trajectory_texture` share theirs.

    Raises:
        ConfigurationChanged: if `out` holds pictures of other settings.
        RegionError: if the lumen has no room for views in one of the regions.
    """
    splits = make_splits(setting.scene.anatomy, setting.regions, np.random.default_rng(setting.seed), setting.sizes)
    views = {TRAIN: splits.train, PUBLISHED: splits.published, TRAJECTORY: splits.trajectory}
    views[TRAJECTORY_TEXTURE] = splits.trajectory_texture
    made = {name: _make(setting, name, chosen, out / name, progress) for name, chosen in views.items()}
    return Sets(made[TRAIN], {name: made[name] for name in (PUBLISHED, TRAJECTORY, TRAJECTORY_TEXTURE)})


def _make(setting: Setting, name: str, views: Viewpoints, out: Path, progress: Progress) -> Dataset:
    simulation = Simulation(
        anatomy=setting.scene.anatomy,
        regions=setting.regions,
        views=views,
        intrinsics=setting.intrinsics,
        appearance=setting.unseen if name == TRAJECTORY_TEXTURE else setting.seen,
        seed=10 * setting.seed + _SEED_OF[name],
        views_from=_told(setting, name),
    )
    return simulate(simulation, out, scene=setting.scene, progress=progress)


def _told(setting: Setting, name: str) -> dict[str, Any]:
    return {"kind": "split", "split": name, "sizes": plain(setting.sizes), "seed": setting.seed}
