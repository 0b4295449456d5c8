"""The canary: these fail when the tests run without jaxtyping and beartype over the package."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from naris.core.anatomy import SlabRegions
from naris.core.pose import Pose, rotation_vector


def test_a_wrong_shape_is_refused() -> None:
    with pytest.raises(TypeCheckError):
        rotation_vector(np.eye(4))


def test_a_wrong_type_is_refused() -> None:
    with pytest.raises(TypeCheckError):
        Pose.identity(frame=3)


def test_fields_of_a_dataclass_are_checked() -> None:
    with pytest.raises(TypeCheckError):
        SlabRegions("slabs", ("a", "b"), "LPS", "not an axis", (0.0,))


@pytest.mark.parametrize("decorator", ["njit", "njit(cache=False)", "numba.njit(nogil=True)", "numba.vectorize"])
def test_compiled_functions_are_left_alone(tmp_path, monkeypatch, decorator) -> None:
    """numba reads the bytecode of a function: a checking wrapper would break every kernel."""
    (tmp_path / "naris_kernel_probe.py").write_text(
        f"import numba\nfrom numba import njit\n@{decorator}\ndef twice(x: float) -> float:\n    return 2 * x\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    import jaxtyping

    with jaxtyping.install_import_hook("naris_kernel_probe", "beartype.beartype"):
        module = importlib.import_module("naris_kernel_probe")
    sys.modules.pop("naris_kernel_probe")
    assert module.twice(1.5) == 3.0
