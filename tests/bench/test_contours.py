"""The benchmark of the edges of a frame, in small."""

from __future__ import annotations

import pytest

from naris.bench import BenchRequest, contours


@pytest.mark.slow
def test_a_quick_run_tells_the_error_before_and_after() -> None:
    told = {one.name: one for one in contours.figures(BenchRequest(True, only="contours"))}
    for noise in contours.NOISES:
        base = f"register.contours.{noise}"
        assert 0 <= (told[f"{base}.with_edges"].value or 0) <= 1
        assert told[f"{base}.before_deg"].n == told[f"{base}.after_deg"].n
        assert (told[f"{base}.cpu_s"].value or 0) > 0
