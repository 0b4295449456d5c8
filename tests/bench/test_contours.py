"""The benchmark of the edges and the shading of a frame, in small."""

from __future__ import annotations

import pytest

from naris.bench import BenchRequest, contours


@pytest.mark.long
def test_a_quick_run_tells_the_error_before_and_after() -> None:
    told = {one.name: one for one in contours.figures(BenchRequest(True, only="contours"))}
    for base in (f"register.{name}.{noise}" for name in contours.METHODS for noise in contours.NOISES):
        assert 0 <= (told[f"{base}.{contours.METHODS[base.split('.')[1]]}"].value or 0) <= 1
        assert told[f"{base}.before_deg"].n == told[f"{base}.after_deg"].n
        assert (told[f"{base}.cpu_s"].value or 0) > 0
