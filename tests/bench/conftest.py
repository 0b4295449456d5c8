"""A tube prepared for registration, and a view in it."""

from __future__ import annotations

import pytest

from naris.bench.trials import Trial, drawn_trials
from naris.register.map import RegistrationMap, registration_map
from tests.winding_tube import winding_tube


@pytest.fixture(scope="package")
def tube() -> RegistrationMap:
    return registration_map(winding_tube(), 3.0)


@pytest.fixture(scope="package")
def trial() -> Trial:
    return drawn_trials(winding_tube(), 1, 3)[0]
