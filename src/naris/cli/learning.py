"""What `naris train` is asked for, in the nouns of the library: which configuration, on what."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from naris.cli.anatomies import open_anatomy
from naris.cli.looks import look
from naris.cli.train import Options
from naris.core.camera import Intrinsics
from naris.core.progress import Progress
from naris.dataset.layout import ABOUT
from naris.dataset.read import Dataset
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
"""Options that a data set takes alone: views at will are drawn on all cores for one run after the other."""


def carry_out(options: Options, progress: Progress) -> list[TrainingRun]:
    """Train what the options say; one run a seed.

    Raises:
        NarisError: whatever the stages raise.
    """
    if len(set(options.seeds)) != len(options.seeds) or not options.seeds:
        raise InputError("seeds that differ", f"{options.seeds}", "give each once")
    folder = Path(options.source)
    if (folder / ABOUT).is_file():
        _refuse(options, _OF_VIEWS, "an anatomy", "the data set")
        examples = Examples.of(Dataset.open(folder))
        config = _lasting(PUBLISHED if options.network == "two-layer" else COMPACT_FEW, options)
        if len(options.seeds) > 1:
            workers = options.workers or 1
            return train_runs(examples, config, options.seeds, options.out, workers=workers, progress=progress)
        return [train(examples, config.with_(seed=options.seeds[0]), options.out, progress=progress)]
    _refuse(options, _OF_RUNS, "a data set", "the anatomy")
    two_layer = PUBLISHED.lasting(steps=_TWO_LAYER_STEPS)
    config = _lasting(two_layer if options.network == "two-layer" else COMPACT_AT_WILL, options)
    stream = _stream(options, config.network.input_px)
    return [
        train(stream, config.with_(seed=seed), folder, progress=progress, task=f"train, seed {seed}")
        for seed, folder in _folders(options).items()
    ]


def _refuse(options: Options, names: Sequence[str], goes_with: str, got: str) -> None:
    """Options that say nothing about what is learned from must not be passed over in silence."""
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(options, name) is not None]
    if given:
        todo = f"leave {'it' if len(given) == 1 else 'them'} out"
        raise InputError(f"{', '.join(given)} only with {goes_with}", f"{got} {options.source}", todo)


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
