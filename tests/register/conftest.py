"""One nose prepared for registration, and trials in it, for all tests of this room."""

from __future__ import annotations

import numpy as np
import pytest

from naris.bench.trials import drawn_trials
from naris.register.map import registration_map
from tests import simulated_head


@pytest.fixture(scope="session")
def nose():
    return simulated_head.bare_nose()


@pytest.fixture(scope="session")
def prepared_nose(nose):
    return registration_map(nose, places_mm=2.0)


@pytest.fixture(scope="session")
def trials(nose, prepared_nose):
    """Six views with something to see: of a bare wall at 2 mm there are many alike."""
    drawn = drawn_trials(nose, 24, 11)
    return [one for one in drawn if np.nanmedian(one.ranges["a"]) > 4.0][:6]
