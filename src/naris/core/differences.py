"""What two configurations differ in, in words, for a refusal that tells why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

_MOST_TOLD = 3
_LONGEST_TOLD = 40


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
