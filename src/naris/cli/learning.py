"""What `naris train` is asked for, in the nouns of the library: which configuration, on what."""

from __future__ import annotations

from pathlib import Path

from naris.anatomy.folder import BUILTIN, DESCRIPTION
from naris.anatomy.read import READERS
from naris.cli.anatomies import is_anatomy, open_anatomy
from naris.cli.datasets import is_dataset, is_original, named_regions, open_dataset
from naris.cli.looks import look
from naris.cli.options import refuse
from naris.cli.train import Options
from naris.core.camera import Intrinsics
from naris.core.progress import Progress
from naris.dataset.layout import ABOUT
from naris.dataset.original import FRAMES, POSES
from naris.dataset.stream import MANY_SCOPES, ONE_SCOPE, ViewStream, view_stream
from naris.errors import InputError
from naris.render.scene import Scene
from naris.render.viewpoints import VIEW_DISTRIBUTIONS
from naris.train import COMPACT_AT_WILL, COMPACT_FEW, PUBLISHED, Examples, TrainConfig, TrainingRun, train, train_runs

_TWO_LAYER_STEPS = 1920
"""Of the two-layer network on views at will: about as many batches as 30 epochs of the published training."""

_OF_VIEWS = ("regions", "views", "appearance", "scopes", "fov_deg")
"""Options that say which views of an anatomy to learn from; a data set has its own."""

_OF_RUNS = ("workers",)
"""Options that several runs on a data set take alone: views at will are drawn on all cores for one after the other."""

_OF_ONE_SCOPE = ("fov_deg",)
"""Options of the one camera; many scopes have angles of their own."""


def carry_out(options: Options, progress: Progress) -> list[TrainingRun]:
    """Train what the options say; one run a seed.

    Raises:
        NarisError: whatever the stages raise.
    """
    if len(set(options.seeds)) != len(options.seeds) or not options.seeds:
        raise InputError("seeds that differ", f"{options.seeds}", "give each once")
    folder = Path(options.source)
    if is_dataset(folder):
        of_views = tuple(name for name in _OF_VIEWS if not (name == "regions" and is_original(folder)))
        refuse(options, of_views, "only with an anatomy", f"the data set {options.source}")
        if len(options.seeds) == 1:
            refuse(options, _OF_RUNS, "only with several --seeds", "one seed")
        examples = Examples.of(open_dataset(folder, named_regions(options.regions)))
        config = _lasting(PUBLISHED if options.network == "two-layer" else COMPACT_FEW, options)
        if len(options.seeds) > 1:
            workers = options.workers or 1
            return train_runs(examples, config, options.seeds, options.out, workers=workers, progress=progress)
        return [train(examples, config.with_(seed=options.seeds[0]), options.out, progress=progress)]
    if not is_anatomy(options.source):
        raise _neither(options.source)
    refuse(options, _OF_RUNS, "only with a data set", f"the anatomy {options.source}")
    if options.scopes == "many":
        refuse(options, _OF_ONE_SCOPE, "only with one camera", "--scopes many")
    two_layer = PUBLISHED.lasting(steps=_TWO_LAYER_STEPS)
    config = _lasting(two_layer if options.network == "two-layer" else COMPACT_AT_WILL, options)
    stream = _stream(options, config.network.input_px)
    return [
        train(stream, config.with_(seed=seed), folder, progress=progress, task=f"train, seed {seed}")
        for seed, folder in _folders(options).items()
    ]


def _neither(source: str) -> InputError:
    """What to say of a path where there is nothing to learn from."""
    path = Path(source)
    got = f"the folder {source} with neither" if path.is_dir() else f"the file {source}"
    return InputError(
        f"a data set (a folder with {ABOUT}, made by naris simulate, or with {FRAMES}/ and {POSES}/) or an anatomy "
        f"({BUILTIN}, a surface file "
        f"{', '.join(READERS)}, or a folder with {DESCRIPTION}, made by naris anatomy)",
        got if path.exists() else f"nothing at {source}",
        "check the path",
    )


def _folders(options: Options) -> dict[int, Path]:
    if len(options.seeds) == 1:
        return {options.seeds[0]: options.out}
    return {seed: options.out / f"seed-{seed}" for seed in options.seeds}


def _lasting(preset: TrainConfig, options: Options) -> TrainConfig:
    """The preset, for as long as was asked."""
    asked = {"epochs": options.epochs, "steps": options.steps, "budget_s": options.budget_s}
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1:
        raise InputError("one of --epochs, --steps and --budget-s", " and ".join(given), "leave all but one out")
    return preset.lasting(epochs=options.epochs, steps=options.steps, budget_s=options.budget_s) if given else preset


def _stream(options: Options, size_px: int) -> ViewStream:
    anatomy, regions = open_anatomy(options.source, options.regions)
    return view_stream(
        Scene(anatomy),
        regions,
        VIEW_DISTRIBUTIONS[options.views or "inspection"],
        look(options.appearance or "training"),
        Intrinsics.from_vertical_fov(size_px, size_px, 45.0 if options.fov_deg is None else options.fov_deg),
        options.seeds[0],
        MANY_SCOPES if options.scopes == "many" else ONE_SCOPE,
    )
