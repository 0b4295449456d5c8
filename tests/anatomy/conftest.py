"""The mean nose with its distance, once for all tests of this folder."""

import pytest

from naris.anatomy.distance import signed_distance
from naris.anatomy.read import read_surface
from naris.core.anatomy import Enclosed


@pytest.fixture(scope="session")
def mean_nose(mean_nose_ply):
    """The published surface and the distance in its air."""
    anatomy = read_surface(mean_nose_ply)
    return anatomy, signed_distance(anatomy)


@pytest.fixture(scope="session")
def mean_tissue(mean_nose_ply):
    """The same with its inside for a lumen: a crooked one, of which other libraries can tell the inside too."""
    anatomy = read_surface(mean_nose_ply, airspace=Enclosed())
    return anatomy, signed_distance(anatomy)
