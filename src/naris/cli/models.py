"""Which model a command line means."""

from __future__ import annotations

from pathlib import Path

from naris.errors import CheckpointError
from naris.model.localizer import Localizer, open_localizer
from naris.train.loop import MODEL


def open_model(path: Path) -> Localizer:
    """The model in a file, or in the folder of a training.

    Raises:
        CheckpointError: if there is none or it is damaged.
    """
    if path.is_dir():
        if not (path / MODEL).is_file():
            raise CheckpointError(
                f"a finished training in {path}", f"no {MODEL}", "give a model or finish the training"
            )
        path = path / MODEL
    return open_localizer(path)
