"""What the chain came to on each frame of a patient, kept in a file so that a benchmark goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from naris.core.atomic import write_json
from naris.errors import InputError

SCHEMA = "naris.chain/3"


@dataclass(frozen=True)
class Outcome:
    """One registration beside the truth.

    Attributes:
        wall_mm: mean target registration error of the wall ahead (`naris.core.targets`), of the most likely pose.
        landmarks_mm: the same of the anatomy's landmarks; None where it has none.
        accepted: not refused.
        cpu_s: from the frame, where the belief asks for it, and the depth to the pose, but for the choice among what a
            library came to.
    """

    wall_mm: float
    landmarks_mm: float | None
    accepted: bool
    cpu_s: float


@dataclass(frozen=True)
class FrameRecord:
    """One frame.

    Attributes:
        region: the true one.
        said: by network, the most probable one.
        pose_mm, pose_deg: how far off the best hypothesis of the compact network is.
        found: by noise and belief.
        by_others: by noise and solver (`naris.bench.in_our_place`), those that were installed; they refuse nothing.
        commit: of the code that measured it.
    """

    region: str
    said: Mapping[str, str]
    pose_mm: float
    pose_deg: float
    found: Mapping[str, Mapping[str, Outcome]]
    by_others: Mapping[str, Mapping[str, Outcome]]
    commit: str | None


@dataclass(frozen=True)
class Fit:
    """How long the compact network learned a patient."""

    wall_s: float
    cpu_s: float
    pictures: int


@dataclass(frozen=True)
class PatientRecord:
    """A patient.

    Attributes:
        key: its name and its folder's.
        anatomy: name and digest.
        real: whether it is from a real scan.
        fit: of its own network.
        frames: so far.
    """

    key: str
    anatomy: str
    real: bool
    fit: Fit
    frames: tuple[FrameRecord, ...] = ()

    def with_frame(self, frame: FrameRecord) -> PatientRecord:
        return replace(self, frames=(*self.frames, frame))


def write_record(record: PatientRecord, path: Path) -> None:
    """Whole or not at all.

    Raises:
        DiskFull: if there is no room.
    """
    write_json(path, {"schema": SCHEMA, **asdict(record)})


def read_record(path: Path) -> PatientRecord | None:
    """The inverse; None where there is no file.

    Raises:
        InputError: if it is no such record.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        if raw.pop("schema") != SCHEMA:
            raise ValueError("schema")
        frames = tuple(_frame(one) for one in raw.pop("frames"))
        return PatientRecord(fit=Fit(**raw.pop("fit")), frames=frames, **raw)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"what was measured on a patient in {path}", f"{error!r}", "remove that file") from error


def _frame(raw: dict[str, object]) -> FrameRecord:
    found, by_others = _outcomes(raw.pop("found")), _outcomes(raw.pop("by_others"))
    return FrameRecord(found=found, by_others=by_others, **raw)  # type: ignore[arg-type]


def _outcomes(raw: object) -> dict[str, dict[str, Outcome]]:
    if not isinstance(raw, dict):
        raise TypeError("outcomes")
    return {noise: {name: Outcome(**one) for name, one in each.items()} for noise, each in raw.items()}
