"""The whole pipeline on the built-in nose, in minutes: what naris does, on a machine that has nothing but naris."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from naris.anatomy.builtin import built_in_nose
from naris.core.atomic import write_json
from naris.core.progress import SILENT, Progress
from naris.core.provenance import plain
from naris.dataset.splits import SplitSizes
from naris.dataset.stream import view_stream
from naris.errors import InputError
from naris.experiment.claim import claim
from naris.experiment.contenders import (
    COMPACT_AT_WILL,
    COMPACT_WORDS,
    STEERED_SHARE,
    TWO_LAYER,
    TWO_LAYER_LABEL,
    TWO_LAYER_WORDS,
    Contender,
    Plan,
    from_pictures,
    from_views_at_will,
)
from naris.experiment.gather import Telling, locate_some, network_result, report_data
from naris.experiment.score import score
from naris.experiment.sets import TRAJECTORY, Sets, Setting, make_sets
from naris.experiment.stages import EVALUATE, PICTURES, Journal
from naris.experiment.start_weights import NOSES, START_WEIGHTS
from naris.model.checkpoint import load_checkpoint
from naris.model.compact import CompactConfig
from naris.render.appearance import TRAINING_APPEARANCE, UNSEEN_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import TRAVEL
from naris.report.data import ReportData
from naris.train import COMPACT_DEMO, PUBLISHED
from naris.train.pace import quicker_threads

REGIONS = "paper"
LOOKS = replace(TRAINING_APPEARANCE, flat=0.0)
"""Of the training: three minutes are too few to learn a second kind of light as well, which no test here has."""

VIEWS = "views"
BUDGET = "budget.json"
_LEAST_S = 60.0
FEW_PICTURES = 40_000
"""Half of what the network is shown in its time where nothing else runs on two cores (`demo.training_pictures`)."""
_RESERVE_S = 15.0  # for what comes after the training


@dataclass(frozen=True)
class DemoConfig:
    """How much of what; the defaults fit into five minutes on two cores.

    Attributes:
        train_positions, test_positions: of the fixed sets.
        per_position: views at each of them; fewer than the publication's ten, at more places in exchange.
        epochs: of the two-layer network on the fixed training set.
        within_s: wall seconds for everything; the compact network, which learns from views at will, gets what the
            other stages leave, but not less than a minute.
        budget_s: wall seconds for the compact network instead.
        located: pictures that are located one by one for the report.
        seed: of everything.
    """

    train_positions: int = 120
    test_positions: int = 48
    per_position: int = 4
    epochs: int = 3
    within_s: float = 276.0
    budget_s: float | None = None
    located: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        seconds = self.within_s if self.budget_s is None else min(self.within_s, self.budget_s)
        counts = (self.train_positions, self.test_positions, self.per_position, self.epochs, self.located)
        if min(counts) < 1 or not seconds > 0:
            raise InputError("at least one position, epoch and second", f"{self}", "raise the number below 1")


def demo(
    out: Path, config: DemoConfig = DemoConfig(), *, command: str = "naris demo", progress: Progress = SILENT
) -> ReportData:
    """Anatomy → pictures → training → evaluation on unseen trajectories and textures → a few located frames.

    Raises:
        ConfigurationChanged: if `out` holds a demo with other settings.
        InputError: if `out` holds something else.
        DiskFull: if there is no room.
    """
    new = claim(out, {"experiment": "demo", "config": plain(config)})
    journal = Journal.open(out, new=new)
    with journal.stage("anatomy"), progress.task("anatomy", 1) as advance:
        anatomy = built_in_nose()
        scene = Scene(anatomy)
        advance(1)
    faces = f"{len(anatomy.faces):,} triangles, {len(anatomy.passages)} passages"
    journal.note("anatomy", f"the built-in nose: {faces}")
    sizes = SplitSizes(config.train_positions, config.test_positions, config.per_position)
    setting = Setting(scene, anatomy.region_set(REGIONS), LOOKS, UNSEEN_APPEARANCE, sizes, config.seed)
    with journal.stage(PICTURES):
        sets = make_sets(setting, out / PICTURES, progress)
    journal.note(PICTURES, f"{len(sets.train)} to train and {sum(map(len, sets.tests.values()))} to test")
    contenders = _train(setting, sets, config, out, journal, progress)
    telling = Telling("demo", "naris on its built-in nose", command, "solid procedural mucosa, drawn for every picture")
    with journal.stage(EVALUATE):
        networks = [network_result(contender, score(contender, sets.tests, progress)) for contender in contenders]
        located = locate_some(contenders[0], sets, config.located, config.seed, progress)
        data = report_data(telling, setting, sets, networks, located)
    journal.note(EVALUATE, f"{len(contenders)} networks on {len(sets.tests)} splits")
    return replace(data, stages=tuple(journal.stages))


def _train(
    setting: Setting, sets: Sets, config: DemoConfig, out: Path, journal: Journal, progress: Progress
) -> list[Contender]:
    """The compact network last, in the time that is left, and first in the report: it is what the demo is about.

    It gets two threads even on two cores where that is faster, as rendering leaves most of a core idle; on a machine
    that is busy with other things it would be many times slower.
    """
    two_layer = Plan(
        TWO_LAYER,
        TWO_LAYER_LABEL,
        TWO_LAYER_WORDS,
        f"{len(sets.train)} fixed pictures, {config.epochs} epochs: far less than in the publication.",
        replace(PUBLISHED, epochs=config.epochs),
        (config.seed,),
    )
    trained = from_pictures(two_layer, sets.train, out, journal, progress)
    size_px = COMPACT_DEMO.network.input_px
    camera = setting.intrinsics.resized(size_px, size_px)
    with journal.stage(VIEWS):
        stream = view_stream(setting.scene, setting.regions, TRAVEL, LOOKS, camera, config.seed)
        stream = stream.with_steered(STEERED_SHARE).away_from(sets.tests[TRAJECTORY].anatomy_T_camera)
    journal.note(VIEWS, "where views at will may be drawn")
    threads = quicker_threads(cast(CompactConfig, COMPACT_DEMO.network), max(2, COMPACT_DEMO.torch_threads))
    budget_s = _budget_s(config, out, journal)
    at_will = Plan(
        COMPACT_AT_WILL,
        "compact, views at will",
        COMPACT_WORDS,
        f"Views rendered as it learns, half of them of a steered camera, for {budget_s:.0f} s, from weights that know"
        f" {NOSES} other noses.",
        COMPACT_DEMO.lasting(budget_s=budget_s).with_(threads=threads),
        (config.seed,),
        start=load_checkpoint(START_WEIGHTS),
    )
    return [from_views_at_will(at_will, stream, out, journal, progress), trained]


def _budget_s(config: DemoConfig, out: Path, journal: Journal) -> float:
    """Seconds for the compact network: decided once, so that a demo that is taken up again goes on with them."""
    if config.budget_s is not None:
        return config.budget_s
    path = out / BUDGET
    try:
        return float(json.loads(path.read_text(encoding="utf-8"))["budget_s"])
    except (OSError, ValueError, LookupError, TypeError):
        budget_s = round(max(config.within_s - journal.so_far_s() - _RESERVE_S, _LEAST_S), 1)
        write_json(path, {"budget_s": budget_s})
        return budget_s
