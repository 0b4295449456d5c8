"""Pictures with poses, regions and depth on disk, and read again.

python examples/02_a_data_set.py [FOLDER] [COUNT]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from naris.anatomy.builtin import built_in_nose
from naris.core.camera import Intrinsics
from naris.dataset.generate import Simulation, simulate
from naris.dataset.original import write_original
from naris.dataset.read import Dataset
from naris.dataset.stream import view_stream
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import INSPECTION, draw_views


def main(folder: Path, count: int = 60) -> None:
    """Draws views as an endoscopist would see them, each with a look of its own, and writes them."""
    scene = Scene(built_in_nose())
    camera = Intrinsics.from_vertical_fov(160, 160, 60.0)
    stream = view_stream(scene, scene.anatomy.region_set("paper"), INSPECTION, TRAINING_APPEARANCE, camera, seed=0)

    # The same seed gives the same bytes. Stop it at any time: the same call goes on where it was.
    views = draw_views(scene, stream.bank, count, np.random.default_rng(0))
    simulation = Simulation(scene.anatomy, stream.regions, views, camera, TRAINING_APPEARANCE, seed=0)
    simulate(simulation, folder / "pictures", scene=scene)

    dataset = Dataset.open(folder / "pictures")
    sample = dataset[0]
    print(f"{len(dataset)} pictures of {dataset.anatomy_name}, {camera.width}×{camera.height}")
    for name, n in zip(dataset.regions.names, np.bincount(dataset.labels), strict=True):
        print(f"  {n:3d} from {name}")
    print(f"the first was taken at {sample.anatomy_T_camera.position_mm.round(1)} mm")

    # The folders of the published code, for whoever has tools for them.
    write_original(dataset, folder / "original")
    print(f"wrote {folder / 'pictures'} and {folder / 'original'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/examples"), *map(int, sys.argv[2:3]))
