"""The exceptions of naris, all in one tree.

NarisError
├── InputError                  what the user gave cannot be used (exit status 2)
│   ├── ScanError               not a CT, or one whose geometry is incomplete or contradicts itself
│   ├── SurfaceError            not a mesh, open, inside out, in the wrong unit
│   ├── PoseError               not a rigid transform, NaN, wrong frame, outside the lumen
│   ├── RegionError             unknown region, or a model made for other regions
│   ├── KeyframeError           a keyframe file that cannot be read or used
│   ├── ImageError              not a picture, or one of the wrong size
│   ├── DatasetError            a data set that is incomplete or inconsistent
│   ├── ConfigurationChanged    the output was made with other settings
│   ├── CheckpointError         a weights file that is truncated or of another network
│   └── FetchError              a download that failed or has the wrong digest
└── MachineError                what naris needs from the machine is missing (exit status 2)
    ├── DiskFull                no room to write
    └── EngineUnavailable       the asked rendering engine cannot start here

Every message is one sentence in three parts: what was expected, what came, what to do. `differences` says in words what
two configurations differ in, for those that tell of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

_MOST_TOLD = 3
_LONGEST_TOLD = 40


class NarisError(Exception):
    """The root of every error that naris raises on purpose.

    `expected`, `got` and `todo` are clauses without a full stop; the message joins them.
    """

    def __init__(self, expected: str, got: str | None = None, todo: str | None = None) -> None:
        self.expected, self.got, self.todo = expected, got, todo
        message = f"expected {expected}" if got is not None else expected
        if got is not None:
            message += f", got {got}"
        if todo is not None:
            message += f"; {todo}"
        super().__init__(message)


class InputError(NarisError):
    """What the user gave cannot be used."""


class ScanError(InputError):
    """The scan is not a CT that can be read, or its geometry is incomplete or contradicts itself."""


class SurfaceError(InputError):
    """The surface is not a mesh, is open, inside out, or in the wrong unit."""


class PoseError(InputError):
    """The pose is not a rigid transform, is not finite, or stands in the wrong frame or place."""


class RegionError(InputError):
    """The region is unknown, or the model was made for other regions."""


class KeyframeError(InputError):
    """The keyframe file cannot be read or used."""


class ImageError(InputError):
    """The file is not a picture, or one of the wrong size."""


class DatasetError(InputError):
    """The data set is incomplete or inconsistent."""


class ConfigurationChanged(InputError):
    """The output folder was made with other settings."""


class CheckpointError(InputError):
    """The weights file is truncated, damaged, or belongs to another network."""


class FetchError(InputError):
    """The download failed or what came has the wrong digest."""


class MachineError(NarisError):
    """What naris needs from the machine is missing."""


class DiskFull(MachineError):
    """There is no room to write."""


class EngineUnavailable(MachineError):
    """The asked rendering engine cannot start on this machine."""


def differences(old: object, new: Mapping[str, Any], called: Mapping[str, str]) -> str:
    """What differs between two configurations, for `ConfigurationChanged`: `--seed (0 → 1), --epochs (none → 5)`.

    At most three settings are told. Values that are long or no plain ones are left out.

    Args:
        old: as it was recorded, from JSON; nothing is told of one that is no object.
        new: as JSON would hold it.
        called: what people call a setting, or a group of settings, by its keys with dots between them; those are told
            first, in this order.
    """
    if not isinstance(old, Mapping):
        return ""
    before, after = dict(_settings(old)), dict(_settings(new))
    told: dict[str, str] = {}
    for key in sorted({*before, *after}, key=lambda key: _rank(key, called)):
        if before.get(key) != after.get(key):
            name, was, now = _name(key, called), _word(before.get(key)), _word(after.get(key))
            told.setdefault(name, name if was is None or now is None else f"{name} ({was} → {now})")
    some = list(told.values())[:_MOST_TOLD]
    return ", ".join(some) + (f" and {len(told) - len(some)} more" if len(told) > len(some) else "")


def _settings(configuration: object, of: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(configuration, Mapping):
        for key, value in configuration.items():
            yield from _settings(value, f"{of}.{key}" if of else str(key))
    else:
        yield of, configuration


def _group(key: str, called: Mapping[str, str]) -> str | None:
    """The setting itself or the smallest group around it that has a name."""
    while key and key not in called:
        key = key.rpartition(".")[0]
    return key or None


def _rank(key: str, called: Mapping[str, str]) -> tuple[int, str]:
    group = _group(key, called)
    return (len(called) if group is None else list(called).index(group)), key


def _name(key: str, called: Mapping[str, str]) -> str:
    group = _group(key, called)
    return key.replace(".", " ").replace("_", " ") if group is None else called[group]


def _word(value: object) -> str | None:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.10g}"
    return str(value) if isinstance(value, (int, str)) and len(str(value)) <= _LONGEST_TOLD else None
