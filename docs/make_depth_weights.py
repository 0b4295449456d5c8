"""Makes the depth network that ships with naris, and judges it in noses that it has not seen.

    python docs/make_depth_weights.py [FOLDER]     FOLDER of the training, out/depth if none is given

Three quarters of an hour on two cores; the same command goes on where it was stopped. The weights replace
`src/naris/locate/weights/depth.safetensors`, and the table in `docs/depth_network.md` is filled.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, drawn_trials, frames
from naris.cli.console import console_for
from naris.core.atomic import write_json, write_text
from naris.core.camera import Intrinsics
from naris.core.pose import stack
from naris.core.progress import Progress
from naris.core.provenance import file_digest
from naris.evaluate.depth import DepthErrors, error_model
from naris.experiment.depth_weights import NOSES, SEED, depth_streams
from naris.experiment.start_weights import START_WEIGHTS
from naris.locate.depth import DEPTH_WEIGHTS, SCHEMA, open_depth, run
from naris.locate.view import views_of
from naris.model.checkpoint import load_checkpoint, write_tensors
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene, render
from naris.train.depth import DepthLessons, DepthTraining, cell_log_ranges, train_depth

CARD = Path(__file__).with_name("depth_network.md")
BEGIN, END = "<!-- figures -->", "<!-- end -->"
RUN = "run.json"
JUDGED_SEED, PATIENTS, VIEWS = 6_000_000, 16, 12


def main(arguments: list[str]) -> None:
    """Trains, puts the weights in their place, and tells how good they are."""
    folder = Path(arguments[0] if arguments else "out/depth")
    progress = console_for(set()).progress
    config = DepthTraining()
    if not (folder / RUN).is_file():
        lessons = DepthLessons(depth_streams(NOSES, SEED, config.network.input_px, progress), config)
        made = train_depth(lessons, folder, start=load_checkpoint(START_WEIGHTS).weights, progress=progress)
        about = {"pictures": made.pictures, "wall_s": made.wall_s, "cpu_s": made.cpu_s}
        write_tensors(DEPTH_WEIGHTS, SCHEMA, about, made.weights)
        write_json(folder / RUN, about | {"losses": np.round(made.losses, 4).tolist()})
    kept = json.loads((folder / RUN).read_text(encoding="utf-8"))
    write_text(CARD, filled(CARD.read_text(encoding="utf-8"), kept, config, judged(config, progress)))


def judged(config: DepthTraining, progress: Progress) -> dict[str, DepthErrors]:
    """In virtual patients that were not learned from, under looks like those of the training and others."""
    size, found = config.network.input_px, dict[str, list[tuple[np.ndarray, np.ndarray]]]()
    camera = Intrinsics.from_vertical_fov(size, size, CAMERA_OF_TRIALS.vertical_fov_deg)
    network = open_depth().network
    with progress.task("judging", PATIENTS) as advance:
        for number in range(PATIENTS):
            nose = virtual_patient(JUDGED_SEED, number)
            trials = drawn_trials(nose, VIEWS, JUDGED_SEED + number)
            poses, scene = stack([trial.anatomy_T_camera for trial in trials]), Scene(nose)
            depth = render(scene, poses, camera, want=("depth",)).depth_mm
            rng = np.random.default_rng([JUDGED_SEED, number])
            looks = [TRAINING_APPEARANCE.sample(rng) for _ in trials]
            known = render(scene, poses, camera, looks, want=("rgb",)).rgb
            if depth is None or known is None:
                continue
            whole = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
            images = frames(nose, trials, JUDGED_SEED + number)
            unseen = np.concatenate([views_of(image, size, camera, whole) for image in images])
            for name, pictures in (("as in the training", known), ("unseen", unseen)):
                told, spread = run(network, pictures, np.full(len(pictures), size / 2 / camera.fy))
                found.setdefault(name, []).append((told - cell_log_ranges(depth, camera), spread))
            advance(1)
    cell_deg = CAMERA_OF_TRIALS.vertical_fov_deg / config.network.cells
    return {
        name: DepthErrors(np.concatenate([e for e, _ in some]), np.concatenate([s for _, s in some]), cell_deg)
        for name, some in found.items()
    }


def filled(card: str, run: dict[str, float], config: DepthTraining, errors: dict[str, DepthErrors]) -> str:
    """The card with its table."""
    made = {
        "noses, steps, pictures": f"{NOSES}, {config.steps:,}, {run['pictures']:,}",
        "seeds": f"{SEED} of the noses, {config.seed} of the views",
        "wall, CPU": f"{run['wall_s']:.0f} s, {run['cpu_s']:.0f} s",
        "SHA-256": file_digest(DEPTH_WEIGHTS),
    }
    for name, found in errors.items():
        model = error_model(found)
        made[f"looks {name}: error of shape, median (middle half of the pictures)"] = _percent(found.shape)
        made[f"looks {name}: factor on the whole, one standard deviation"] = f"{100 * found.scale.std():.0f} %"
        made[f"looks {name}: what errors are of what is claimed"] = (
            f"factor {model.scale:.2f}, smooth {model.smooth:.2f} over {model.reach_deg:.0f}°, own {model.own:.2f}"
        )
    rows = "\n".join(f"| {name} | {value} |" for name, value in made.items())
    head, _, rest = card.partition(BEGIN)
    return f"{head}{BEGIN}\n| | |\n|---|---|\n{rows}\n{END}{rest.partition(END)[2]}"


def _percent(values: np.ndarray) -> str:
    low, middle, high = 100 * np.quantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.1f} % ({low:.1f}–{high:.1f} %)"


if __name__ == "__main__":
    main(sys.argv[1:])
