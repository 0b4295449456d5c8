"""What a training's result comes of, so that a folder with another's is refused, and the refusal says what differs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from naris.core.differences import differences
from naris.core.provenance import digest, plain
from naris.errors import ConfigurationChanged
from naris.model.checkpoint import Checkpoint
from naris.train.config import TrainConfig
from naris.train.data import Lessons, StreamLessons, stream_description

_ASKED = {"kind": "--network", "epochs": "--epochs", "steps": "--steps", "budget_s": "--budget-s", "seed": "--seeds"}
"""The settings that somebody types, as they are typed; the others come with the network and the kind of data."""
_ONLY_HOW = ("threads", "state_every_s")
_DATA = {
    "kind": "what is learned from", "anatomy": "the anatomy", "passages": "the anatomy", "parts": "the anatomies",
    "regions": "--regions", "views": "--views", "appearance": "--appearance", "scopes": "--scopes",
    "fov_deg": "--fov-deg", "avoid": "the views to keep away from",
    "region_set": "the region set", "camera": "the camera", "pictures": "the pictures",
    "start": "the weights to start from",
}  # fmt: skip
"""What the data are made up of (`_parts`), as people know it."""


@dataclass(frozen=True, eq=False)
class Origin:
    """What a training's result comes of.

    Attributes:
        identity: digest of all of it.
        settings: the configuration as JSON.
        data: what tells later in which of them other data differ: short words and numbers, and digests of the rest.
    """

    identity: str
    settings: dict[str, Any]
    data: dict[str, Any]

    @staticmethod
    def of(config: TrainConfig, lessons: Lessons, start: Checkpoint | None) -> Origin:
        identity = digest([config.made_of, lessons.identity, *([] if start is None else [start.weights])])
        weights = None if start is None else digest(start.weights)
        return Origin(identity, plain(config), {**_parts(lessons), "start": weights})

    def record(self) -> dict[str, Any]:
        return {"identity": self.identity, "settings": self.settings, "data": self.data}

    def check(self, record: Mapping[str, Any], out: Path) -> None:
        """See that what is in a folder comes of the very same; records of older versions tell less of what differs."""
        if record.get("identity") == self.identity:
            return
        told = {"settings": self._settings(record.get("settings")), "data": self._data(record.get("data"))}
        raise ConfigurationChanged(
            f"the settings and data of the training in {out}",
            " and ".join(f"other {name}: {what}" for name, what in told.items() if what) or "others",
            "use another folder or remove that one",
        )

    def _settings(self, old: object) -> str:
        if not isinstance(old, Mapping):
            return ""
        asked = differences(_asked(old), _asked(self.settings), _ASKED)
        before, after = ({k: v for k, v in of.items() if k not in _ONLY_HOW} for of in (old, self.settings))
        return asked or differences(before, after, {})

    def _data(self, old: object) -> str:
        kind = {"kind": self.data["kind"]}
        if isinstance(old, Mapping) and old.get("kind") != kind["kind"]:
            return differences({"kind": old.get("kind")}, kind, _DATA)
        return differences(old, self.data, _DATA)


def _asked(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Of recorded settings, those that somebody asked for: the name of the network, how long and with which seed."""
    kind = "compact" if "hypotheses" in (settings.get("network") or {}) else "two-layer"
    return {"kind": kind, **{name: settings.get(name) for name in _ASKED if name != "kind"}}


def _parts(lessons: Lessons) -> dict[str, Any]:
    """What makes up the data, each in a word, a number or a digest, so that other data can be told by name."""
    subject = lessons.subject
    regions, camera = subject.regions.digest, subject.intrinsics
    if not isinstance(lessons, StreamLessons):
        fixed = {"region_set": regions, "camera": digest(camera), "pictures": lessons.identity}
        return {"kind": "data set", "anatomy": subject.anatomy_digest, **fixed}
    views = stream_description(lessons.stream)
    parts = {name: getattr(value, "name", None) or digest(value) for name, value in views.items() if name in _DATA}
    angle = {"fov_deg": round(camera.vertical_fov_deg, 6)}
    return {**parts, "kind": "views at will", "anatomy": subject.anatomy_digest, "regions": regions, **angle}
