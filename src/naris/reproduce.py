"""The experiment of Sinha et al. 2018, whole: pictures, networks, figures, report.

1,270 training and 150 test pictures of the mean nose, five runs of the two-layer network over 30 epochs; and beside it
what the publication leaves open: test trajectories of their own, an unseen texture, our compact network on the same
pictures, and on views that are rendered as it learns. Every stage is kept in the output folder, so that a run that was
stopped goes on where it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from naris.anatomy import mean_nose
from naris.anatomy.regions import PAPER_SLABS
from naris.core.anatomy import Anatomy
from naris.core.progress import SILENT, Progress
from naris.core.provenance import file_digest, plain
from naris.dataset.splits import SplitSizes
from naris.dataset.stream import ONE_SCOPE, view_stream
from naris.errors import InputError
from naris.experiment.claim import claim
from naris.experiment.contenders import (
    COMPACT,
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
from naris.experiment.start_weights import NOSES, knows, start_for
from naris.fetch import MEAN_NOSE
from naris.render.appearance import PAPER, TRAINING_APPEARANCE, UNSEEN_APPEARANCE
from naris.render.material import TextureColours
from naris.render.scene import Scene
from naris.render.viewpoints import TRAVEL
from naris.report.data import SINHA_2018, NetworkResult, ReportData
from naris.train import COMPACT_AT_WILL as AT_WILL_TRAINING
from naris.train import COMPACT_FEW, COMPACT_ON, PUBLISHED

_TEXTURE = next(file for file in MEAN_NOSE.files if file.name == "sampled_texture.jpg")
_PUBLISHED_EPOCHS, _PUBLISHED_RUNS = 30, 5


@dataclass(frozen=True)
class ReproduceConfig:
    """How much of what.

    Attributes:
        sizes: positions and views of the sets; the default is the published 1,270 + 150 pictures.
        epochs: of the two-layer network.
        runs: of the two-layer network, with seeds 0, 1, …
        compact_epochs: of the compact network on the same pictures.
        compact_runs: of those.
        at_will_steps: batches of views at will for the compact network.
        at_will_runs: of those.
        workers: runs on fixed pictures at a time, each on one thread.
        seed: of the views and looks.
    """

    sizes: SplitSizes = SplitSizes()
    epochs: int = _PUBLISHED_EPOCHS
    runs: int = _PUBLISHED_RUNS
    compact_epochs: int = 40
    compact_runs: int = 5
    at_will_steps: int = 6000
    at_will_runs: int = 1
    workers: int = 2
    seed: int = 0

    def __post_init__(self) -> None:
        counts = (self.epochs, self.runs, self.compact_epochs, self.compact_runs, self.at_will_steps, self.at_will_runs)
        if min(*counts, self.workers) < 1:
            raise InputError("one run, epoch, step and worker or more", f"{counts}", "raise the number below 1")


def reproduce(
    anatomy: Anatomy,
    texture: Path,
    out: Path,
    config: ReproduceConfig = ReproduceConfig(),
    *,
    command: str = "naris reproduce",
    progress: Progress = SILENT,
) -> ReportData:
    """Run the experiment in the folder `out`, or what is still missing of it, and gather what it found.

    Args:
        anatomy: with passages and a region set, the mean nose in the publication.
        texture: the picture that colours the walls of the training pictures, vertex by vertex.
        out: folder of all stages.
        config: how much.
        command: as typed, for the report.
        progress: told of every stage.

    Raises:
        ConfigurationChanged: if `out` holds an experiment with other settings.
        InputError: if the anatomy, its regions or the texture will not do, or `out` holds something else.
        DiskFull: if there is no room; what is there is whole.
    """
    look = PAPER.with_(material=TextureColours.read(texture))
    scene = Scene(anatomy)
    setting = Setting(scene, anatomy.region_set(), look, UNSEEN_APPEARANCE, config.sizes, config.seed)
    new = claim(out, {"experiment": "reproduce", "anatomy": anatomy.digest, "look": plain(look), **_results_in(config)})
    journal = Journal.open(out, new=new)
    with journal.stage(PICTURES):
        sets = make_sets(setting, out / PICTURES, progress)
    journal.note(PICTURES, f"{len(sets.train)} to train and {sum(map(len, sets.tests.values()))} to test")
    faithful = repeats_the_published(anatomy, texture, config)
    known = knows(setting.regions)
    planned = plans(config, len(sets.train), faithful, known)
    contenders = _train(setting, sets, planned, known, out, journal, progress)
    telling = _telling(anatomy, texture, command, faithful)
    with journal.stage(EVALUATE):
        networks = [_scored(contender, sets, progress) for contender in contenders]
        located = locate_some(contenders[-1], sets, 8, config.seed, progress)
        data = report_data(telling, setting, sets, networks, located)
    journal.note(EVALUATE, f"{sum(len(c.runs) for c in contenders)} networks on {len(sets.tests)} splits")
    return replace(data, stages=tuple(journal.stages))


def repeats_the_published(anatomy: Anatomy, texture: Path, config: ReproduceConfig) -> bool:
    """Whether the published figure may be compared with: its nose, regions, texture, numbers of pictures and runs."""
    return (
        mean_nose.is_mean_nose(anatomy.vertices_mm, anatomy.faces)
        and anatomy.region_set() == PAPER_SLABS
        and file_digest(texture) == _TEXTURE.sha256
        and config.sizes == SplitSizes()
        and (config.epochs, config.runs) == (_PUBLISHED_EPOCHS, _PUBLISHED_RUNS)
    )


def _telling(anatomy: Anatomy, texture: Path, command: str, faithful: bool) -> Telling:
    """A figure that was published for another nose, texture or length of training is no measure for this one."""
    picture = f"the picture {texture.name}"
    if faithful:
        title = f"The published experiment on the {anatomy.name}"
        return Telling("reproduce", title, command, f"{picture}, as published", SINHA_2018)
    return Telling("reproduce", f"Modelled on the published experiment: the {anatomy.name}", command, picture)


def _results_in(config: ReproduceConfig) -> dict[str, object]:
    """The settings that decide results, without those that only say how the work is done."""
    return {"config": plain(replace(config, workers=1))}


def _train(
    setting: Setting,
    sets: Sets,
    planned: tuple[Plan, Plan, Plan],
    known: bool,
    out: Path,
    journal: Journal,
    progress: Progress,
) -> list[Contender]:
    two_layer, compact, at_will = planned
    size_px = at_will.config.network.input_px
    stream = view_stream(
        setting.scene,
        setting.regions,
        TRAVEL,
        TRAINING_APPEARANCE,
        setting.intrinsics.resized(size_px, size_px),
        setting.seed,
        ONE_SCOPE,
    )
    stream = stream.with_steered(STEERED_SHARE).away_from(sets.tests[TRAJECTORY].anatomy_T_camera)
    if known:
        at_will = replace(at_will, start=start_for(stream))
    return [
        from_pictures(two_layer, sets.train, out, journal, progress),
        from_pictures(compact, sets.train, out, journal, progress),
        from_views_at_will(at_will, stream, out, journal, progress),
    ]


def plans(config: ReproduceConfig, pictures: int, faithful: bool, known: bool) -> tuple[Plan, Plan, Plan]:
    """The two-layer network, the compact one on the same pictures, and the compact one on views at will.

    The last one starts from weights that know other noses (`naris.experiment.start_weights`) if these know its regions.
    """
    two_layer = Plan(
        TWO_LAYER,
        "two-layer, as published" if faithful else TWO_LAYER_LABEL,
        TWO_LAYER_WORDS,
        f"The {pictures:,} training pictures, {config.epochs} epochs, Adam, batches of 20.",
        PUBLISHED.lasting(epochs=config.epochs),
        tuple(range(config.runs)),
        config.workers,
    )
    compact = Plan(
        COMPACT,
        "compact, same pictures",
        COMPACT_WORDS,
        f"The same {pictures:,} pictures, {config.compact_epochs} epochs, varied in colour, light and camera rotation.",
        COMPACT_FEW.lasting(epochs=config.compact_epochs),
        tuple(range(config.compact_runs)),
        config.workers,
    )
    at_will = Plan(
        COMPACT_AT_WILL,
        "compact, views at will",
        COMPACT_WORDS,
        "Views rendered as it learns, half of them of a camera that is steered through the passages and half anywhere"
        " along them, each with a mucosa, light and sensor of its own"
        + (f"; from weights that know {NOSES} other noses." if known else "."),
        (COMPACT_ON if known else AT_WILL_TRAINING).lasting(steps=config.at_will_steps),
        tuple(range(config.at_will_runs)),
    )
    return two_layer, compact, at_will


def _scored(contender: Contender, sets: Sets, progress: Progress) -> NetworkResult:
    return network_result(contender, score(contender, sets.tests, progress))
