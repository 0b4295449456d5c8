"""Makes the weights that the demo starts from, and judges them in a nose that they have not seen.

    python docs/make_start_weights.py [FOLDER]     FOLDER of the training, out/start-weights if none is given

Half an hour on two cores; the same command goes on where it was stopped. The weights replace
`src/naris/experiment/weights/noses.safetensors`, and the table in `docs/start_weights.md` is filled.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from naris.anatomy.builtin import built_in_nose
from naris.cli.console import console_for
from naris.core.atomic import write_text
from naris.core.progress import Progress
from naris.core.provenance import file_digest
from naris.dataset.splits import SplitSizes
from naris.evaluate import Summary, export, summary
from naris.experiment.sets import Setting, make_sets
from naris.experiment.start_weights import NOSES, REGIONS, START_WEIGHTS, make_start_weights
from naris.render.appearance import TRAINING_APPEARANCE, UNSEEN_APPEARANCE
from naris.render.scene import Scene
from naris.train import TrainingRun, read_run
from naris.train.loop import RUN

CARD = Path(__file__).with_name("start_weights.md")
BEGIN, END = "<!-- figures -->", "<!-- end -->"
TEST = SplitSizes(train_positions=150, test_positions=48)


def main(arguments: list[str]) -> None:
    """Trains, puts the weights in their place, and prints how good they are."""
    folder = Path(arguments[0] if arguments else "out/start-weights")
    progress = console_for(set()).progress
    training = folder / "training"
    # A finished training is taken as it is: to compare it with the noses would mean to make all of them again.
    run = read_run(training) if (training / RUN).is_file() else make_start_weights(training, progress=progress)
    START_WEIGHTS.parent.mkdir(exist_ok=True)
    shutil.copyfile(run.checkpoint, START_WEIGHTS)
    write_text(CARD, filled(CARD.read_text(encoding="utf-8"), run, judged(folder / "test", progress)))


def filled(card: str, run: TrainingRun, scores: dict[str, Summary]) -> str:
    """The card with its table."""
    made = {
        "noses, steps, pictures": f"{NOSES}, {run.steps:,}, {run.pictures:,}",
        "seed": str(run.seed),
        "wall, CPU": f"{run.wall_s:.0f} s, {run.cpu_s:.0f} s",
        "SHA-256": file_digest(START_WEIGHTS),
    }
    for split, found in scores.items():
        low, high = found.interval
        made[f"accuracy, `{split}`"] = f"{100 * found.mean:.1f} % (95 %: {100 * low:.1f}–{100 * high:.1f})"
    rows = "\n".join(f"| {name} | {value} |" for name, value in made.items())
    head, _, rest = card.partition(BEGIN)
    return f"{head}{BEGIN}\n| | |\n|---|---|\n{rows}\n{END}{rest.partition(END)[2]}"


def judged(folder: Path, progress: Progress) -> dict[str, Summary]:
    """By split, in the built-in nose, before any training there."""
    nose = built_in_nose()
    setting = Setting(Scene(nose), nose.region_set(REGIONS), TRAINING_APPEARANCE, UNSEEN_APPEARANCE, TEST, 0)
    tests = make_sets(setting, folder, progress).tests
    return {split: summary([export(START_WEIGHTS, pictures)]) for split, pictures in tests.items()}


if __name__ == "__main__":
    main(sys.argv[1:])
