"""Train the compact network on views that are rendered as it learns, then ask it about pictures it has not seen.

    python examples/03_train_and_locate.py [FOLDER] [SECONDS]

A minute shows how it goes; `naris demo` trains for longer, and `naris train` as long as it is worth.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from naris.anatomy.builtin import built_in_nose
from naris.core.camera import Intrinsics
from naris.dataset.stream import view_stream
from naris.locate import is_localised, locate
from naris.render.appearance import TRAINING_APPEARANCE, UNSEEN_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import INSPECTION
from naris.train import COMPACT_AT_WILL, train


def main(folder: Path, seconds: float = 60.0) -> None:
    """Trains for so long and locates twelve pictures with looks from a distribution of their own."""
    scene = Scene(built_in_nose())
    regions = scene.anatomy.region_set("paper")
    config = COMPACT_AT_WILL.lasting(budget_s=seconds)
    camera = Intrinsics.from_vertical_fov(112, 112, 45.0)
    stream = view_stream(scene, regions, INSPECTION, TRAINING_APPEARANCE, camera, seed=0)
    run = train(stream, config, folder / "model")
    print(f"{run.steps} steps, {run.pictures:,} pictures shown, region loss {run.losses[-1, 1]:.2f}")

    unseen = view_stream(scene, regions, INSPECTION, UNSEEN_APPEARANCE, camera, seed=1).batch(0, 12)
    for number, said in enumerate(locate(list(unseen.images), run.checkpoint)):
        truth, sure = regions.names[unseen.region[number]], float(said.probabilities.max())
        answer = f"{said.region_name} ({sure:.0%})" if is_localised(said) else f"not localised ({sure:.0%} at best)"
        off_mm = np.linalg.norm(said.hypotheses[0].position_mm - unseen.anatomy_T_camera.position_mm[number])
        print(f"  {answer:32} truth: {truth:24} position off by {off_mm:.1f} mm")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/examples"), *map(float, sys.argv[2:3]))
