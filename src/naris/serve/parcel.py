"""Arrays for a browser, in one piece that it need not parse.

A parcel is the word `NARP`, the length of its header (uint32, little-endian), the header (JSON), and the arrays, each
from a multiple of eight bytes on. The header holds `about`, whatever that is, and `arrays`: name → `dtype`, `shape`
and `at`, the byte that it begins at after the header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

MAGIC = b"NARP"
KINDS = ("int8", "uint8", "int16", "uint32", "float32")
"""What a browser has typed arrays for, of these."""
_STEP = 8


def parcel(arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> bytes:
    """Arrays of `KINDS` and what goes with them.

    Raises:
        ValueError: if a browser has no array of such a kind.
    """
    told, parts, at = {}, list[bytes](), 0
    for name, array in arrays.items():
        kind = array.dtype.name
        if kind not in KINDS:
            raise ValueError(f"{name} is {kind}, for which a browser has no array")
        data = _padded(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes())
        told[name] = {"dtype": kind, "shape": list(array.shape), "at": at}
        parts.append(data)
        at += len(data)
    header = json.dumps({"about": about, "arrays": told}, ensure_ascii=True, allow_nan=False).encode()
    header += b" " * (-(len(header) + len(MAGIC) + 4) % _STEP)
    return b"".join([MAGIC, len(header).to_bytes(4, "little"), header, *parts])


def _padded(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % _STEP)
