"""Compiled code is told from that of other sources."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from numba import typeof

from naris.render.sources import sources_of


def test_the_type_changes_with_any_of_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "some_kernel_of_a_test.py"
    kinds = []
    for content in ("a = 1\n", "a = 2\n", "a = 1\n"):
        file.write_text(content)
        importlib.invalidate_caches()
        kinds.append(typeof(sources_of("naris.render.lanes", file.stem)))
    assert kinds[0] == kinds[2] != kinds[1]
    assert typeof(np.zeros(1, np.int32)) != kinds[0]
