"""Which anatomy and which regions a command line means."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.regions import write_regions
from naris.cli.anatomies import open_anatomy
from naris.errors import RegionError
from naris.serve.brush import Brush
from tests.winding_tube import winding_tube


def test_regions_in_which_an_anatomy_has_no_air_are_those_of_another(tube: Path, tmp_path: Path) -> None:
    anatomy = winding_tube()
    grid = Brush(anatomy, anatomy.region_set()).regions
    write_regions(grid, tmp_path / "own.json")
    write_regions(replace(grid, origin_mm=grid.origin_mm + np.array([200.0, 0, 0])), tmp_path / "other.json")
    _, regions = open_anatomy(str(tube), str(tmp_path / "own.json"))
    assert regions.names == grid.names
    with pytest.raises(
        RegionError, match=r"some in which it has no air, from .*other\.json; give those of this anatomy"
    ):
        open_anatomy(str(tube), str(tmp_path / "other.json"))
