"""The simulated trials that a probability is fitted on: patient by patient, kept, by several processes at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from naris.core.atomic import write_json
from naris.core.progress import SILENT, Progress


def trials(
    part: int,
    parts: int,
    patients: int,
    kept: Callable[[int], Path],
    made: Callable[[int], list[list[object]]],
    progress: Progress = SILENT,
) -> list[np.ndarray] | None:
    """The columns of all patients' rows, their number first; None while some patients of other parts are missing.

    Args:
        part, parts: every `parts`-th patient is done here, from number `part` on.
        patients: how many there are.
        kept: the file of a patient by number; what it holds is not done again.
        made: the rows of a patient.
        progress: told of every patient of this part.
    """
    mine = range(part, patients, parts)
    with progress.task("patients", len(mine)) as advance:
        for number in mine:
            if not kept(number).is_file():
                write_json(kept(number), made(number))
            advance(1)
    if not all(kept(number).is_file() for number in range(patients)):
        return None
    done = [(number, *row) for number in range(patients) for row in json.loads(kept(number).read_text())]
    return [np.array(column) for column in zip(*done, strict=True)]
