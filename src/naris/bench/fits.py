"""The simulated trials that a probability is fitted on: patient by patient, kept, by several processes at once."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from naris.core.atomic import write_json


def trials(
    part: int, parts: int, patients: int, kept: Callable[[int], Path], made: Callable[[int], list[list[object]]]
) -> list[np.ndarray] | None:
    """The columns of all patients' rows, their number first; None while some patients of other parts are missing.

    Args:
        part, parts: every `parts`-th patient is done here, from number `part` on.
        patients: how many there are.
        kept: the file of a patient by number; what it holds is not done again.
        made: the rows of a patient.
    """
    begun = time.perf_counter()
    for number in range(part, patients, parts):
        if not kept(number).is_file():
            write_json(kept(number), made(number))
            print(f"patient {number + 1} of {patients}, {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    if not all(kept(number).is_file() for number in range(patients)):
        return None
    done = [(number, *row) for number in range(patients) for row in json.loads(kept(number).read_text())]
    return [np.array(column) for column in zip(*done, strict=True)]
