"""The page in a real browser: pictures load, nothing is wider than the window."""

from __future__ import annotations

import json
import re
import subprocess
from html import unescape
from pathlib import Path

import pytest

from naris.bench.browser import QUIET, browser_path
from naris.report import ReportData, write_report

CHROMIUM = browser_path()
FLAGS = [*QUIET, "--headless", "--disable-gpu"]
PROBE = """<script>
addEventListener("load", () => {
  const wide = [...document.querySelectorAll("body *")].filter(e => !e.closest(".scroll, svg") &&
    e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + "." + e.className);
  const broken = [...document.images].filter(i => !(i.complete && i.naturalWidth)).length;
  const told = {wide, broken, width: innerWidth, images: document.images.length,
    overflow: document.documentElement.scrollWidth - innerWidth};
  document.title = "probe " + JSON.stringify(told);
});
</script>"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: apt-get install chromium)"),
]


def browse(page: Path, profile: Path, *options: str) -> str:
    command = [str(CHROMIUM), *FLAGS, f"--user-data-dir={profile}", *options, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.fixture(scope="module")
def report(reproduce_data: ReportData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(reproduce_data, tmp_path_factory.mktemp("report") / "report.html")


@pytest.mark.parametrize("width", [1280, 700])
def test_pictures_load_and_nothing_sticks_out(report: Path, tmp_path: Path, width: int) -> None:
    page = tmp_path / "probed.html"
    page.write_text(report.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8")
    dom = browse(page, tmp_path / "profile", f"--window-size={width},4000", "--dump-dom")
    told = json.loads(unescape(re.search(r"<title>probe (.*?)</title>", dom).group(1)))  # type: ignore[union-attr]
    assert told["images"] > 30
    assert told["broken"] == 0
    assert told["wide"] == []
    assert told["overflow"] <= 0


def test_screenshot_shows_the_regions(report: Path, reproduce_data: ReportData, tmp_path: Path) -> None:
    import numpy as np
    from PIL import Image

    from naris.report.pictures import region_colours

    shot = tmp_path / "shot.png"
    browse(report, tmp_path / "profile", "--window-size=1280,3000", f"--screenshot={shot}")
    pixels = np.asarray(Image.open(shot).convert("RGB")).reshape(-1, 3)
    for colour in region_colours(reproduce_data.anatomy.regions.names):
        assert (pixels == colour).all(axis=1).sum() > 50  # the swatches of the legend, at least
