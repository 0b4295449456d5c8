"""A parcel read back as a browser reads it: by its header alone, every array where a typed array may begin."""

from __future__ import annotations

import json

import numpy as np
import pytest

from naris.serve.parcel import KINDS, parcel


def read(data: bytes) -> tuple[dict[str, object], dict[str, np.ndarray]]:
    assert data[:4] == b"NARP"
    length = int.from_bytes(data[4:8], "little")
    header = json.loads(data[8 : 8 + length])
    arrays = {}
    for name, told in header["arrays"].items():
        kind = np.dtype(told["dtype"]).newbyteorder("<")
        first = 8 + length + told["at"]
        assert first % 8 == 0
        count = int(np.prod(told["shape"]))
        arrays[name] = np.frombuffer(data, kind, count, first).reshape(told["shape"])
    return header["about"], arrays


def test_all_kinds_come_back() -> None:
    rng = np.random.default_rng(0)
    given = {kind: (50 * rng.standard_normal((3, n))).astype(kind) for n, kind in enumerate(KINDS, 1)}
    given |= {"empty": np.zeros((0, 3), np.float32), "turned": np.arange(12, dtype=np.int16).reshape(3, 4).T}
    about, arrays = read(parcel(given, {"name": "ä nose", "n": 3}))
    assert about == {"name": "ä nose", "n": 3}
    assert list(arrays) == list(given)
    for name, array in given.items():
        np.testing.assert_array_equal(arrays[name], array)


def test_what_a_browser_has_no_array_for_is_refused() -> None:
    with pytest.raises(ValueError, match="x is float64"):
        parcel({"x": np.zeros(3)}, {})
    with pytest.raises(ValueError, match="not JSON compliant"):
        parcel({}, {"x": float("nan")})
