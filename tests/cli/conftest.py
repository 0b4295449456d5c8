"""An anatomy on disk that verbs can work on quickly."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from naris.anatomy.folder import save_anatomy
from tests.winding_tube import winding_tube


@pytest.fixture(scope="session")
def tube(tmp_path_factory) -> Path:
    """The folder of a saved anatomy: a winding tube with four slabs and one passage."""
    folder = tmp_path_factory.mktemp("anatomy") / "tube"
    save_anatomy(winding_tube(), folder)
    return folder


@pytest.fixture(scope="package", autouse=True)
def own_cache(tmp_path_factory) -> Iterator[None]:
    """What verbs keep for the next one stays out of the cache of whoever runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield
