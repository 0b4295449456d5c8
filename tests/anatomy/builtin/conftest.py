"""One built-in nose for all tests of this folder."""

from __future__ import annotations

import pytest

from naris.core.anatomy import Anatomy
from tests import simulated_head


@pytest.fixture(scope="session")
def nose() -> Anatomy:
    return simulated_head.nose()
