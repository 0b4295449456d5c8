"""One built-in nose for all tests of this folder."""

from __future__ import annotations

import pytest

from naris.anatomy.builtin import built_in_nose
from naris.core.anatomy import Anatomy


@pytest.fixture(scope="session")
def nose() -> Anatomy:
    return built_in_nose()
