"""Which models a command line means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from naris.errors import CheckpointError
from naris.model.localizer import Localizer, open_localizer
from naris.train.loop import MODEL


def open_model(path: Path) -> Localizer:
    """The one model in a file, or in the folder of a training.

    Raises:
        CheckpointError: if there is none, or several, or it is damaged.
    """
    files = model_files([path])
    if len(files) > 1:
        raise CheckpointError(f"one model in {path}", f"{len(files)}", f"name one, such as {files[0]}")
    return open_localizer(files[0])


def model_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """The files of all models: each path is one, or a folder of one or of several seeds.

    Raises:
        CheckpointError: if there is none at all, or none in a folder.
    """
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
        elif (path / MODEL).is_file():
            found.append(path / MODEL)
        else:
            seeds = sorted(path.glob(f"seed-*/{MODEL}"), key=lambda file: (len(file.parent.name), file))
            if not seeds:
                below = sorted(path.glob(f"*/**/{MODEL}"))
                todo = f"name one of those below it, such as {below[0]}" if below else "finish it or give a model file"
                raise CheckpointError(f"a finished training in {path}", f"no {MODEL}", todo)
            found += seeds
    if not found:
        raise CheckpointError("a model", "none", "name a file or folder made by naris train")
    return tuple(found)
