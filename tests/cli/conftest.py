"""An anatomy on disk that verbs can work on quickly."""

from __future__ import annotations

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
