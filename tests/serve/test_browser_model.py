"""The page with a model: what it says where the scope is, of a picture that is dropped, and of frames of a video."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from naris.anatomy.folder import save_anatomy
from naris.bench.browser import chromium, missing_browser, opened, steering, until
from naris.cli import main
from tests.winding_tube import winding_tube

LACKS = missing_browser()
pytestmark = [pytest.mark.long, pytest.mark.skipif(LACKS is not None, reason=f"needs {LACKS}")]

# A second of a video of one picture, recorded in the page itself, and dropped on it.
DROP_VIDEO = """
const [data, done] = arguments;
const picture = new Image();
picture.onload = async () => {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d"), parts = [];
  const recorder = new MediaRecorder(canvas.captureStream(20), { mimeType: "video/webm" });
  recorder.ondataavailable = (event) => parts.push(event.data);
  recorder.onstop = () => naris.take(new File(parts, "clip.webm", { type: "video/webm" })).then(() => done(true));
  const drawing = setInterval(() => context.drawImage(picture, 0, 0, 64, 64), 40);
  recorder.start();
  setTimeout(() => { clearInterval(drawing); recorder.stop(); }, 1000);
};
picture.src = "data:image/png;base64," + data;
"""
DROP_FILE = """
const [data, name, done] = arguments;
const bytes = Uint8Array.from(atob(data), (one) => one.charCodeAt(0));
naris.take(new File([bytes], name)).then(() => done(true));
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An anatomy, pictures of it, and a model of one epoch."""
    out = tmp_path_factory.mktemp("steered")
    save_anatomy(winding_tube(), out / "tube")
    size = ["--width", "64", "--height", "64", "--no-depth", "--quiet"]
    assert main(["simulate", str(out / "tube"), "-o", str(out / "set"), "--count", "48", *size]) == 0
    assert main(["train", str(out / "set"), "-o", str(out / "run"), "--epochs", "1", "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def browser(folder: Path) -> Iterator[Any]:
    words = ["tube", "--model", str(folder / "run" / "model.safetensors")]
    with steering(words, folder) as (address, _), chromium(1020, 600) as driver:
        opened(driver, address)
        driver.execute_script("naris.state.paused = true")
        driver.set_script_timeout(60)
        yield driver


def picture_of(folder: Path) -> str:
    files = sorted((folder / "set").rglob("*.png"))
    return base64.b64encode(files[0].read_bytes()).decode()


def said(browser: Any) -> str:
    return str(browser.execute_script("return document.querySelector('#message').textContent"))


def probabilities(browser: Any) -> list[float]:
    script = "return [...document.querySelectorAll('#regions meter')].filter(m => !m.hidden).map(m => m.value)"
    return [float(one) for one in browser.execute_script(script)]


def test_at_rest_the_model_says_which_region_it_believes_in(browser: Any) -> None:
    browser.execute_script("naris.state.paused = false")
    until(lambda: len(probabilities(browser)) == 4)
    browser.execute_script("naris.state.paused = true")
    assert np.sum(probabilities(browser)) == pytest.approx(1, abs=1e-4)


def test_a_picture_that_is_dropped_is_located(browser: Any, folder: Path) -> None:
    browser.execute_async_script(DROP_FILE, picture_of(folder), "frame.png")
    assert said(browser).startswith("frame.png: ")
    assert np.sum(probabilities(browser)) == pytest.approx(1, abs=1e-4)


def test_each_frame_that_a_video_rests_at_is_located(browser: Any, folder: Path) -> None:
    browser.execute_async_script(DROP_VIDEO, picture_of(folder))
    until(lambda: said(browser).startswith("clip.webm at "))
    first = probabilities(browser)
    assert np.sum(first) == pytest.approx(1, abs=1e-4)
    browser.execute_script("document.querySelector('#video-player').currentTime = 0.5")
    until(lambda: said(browser).startswith("clip.webm at 0.50 s: "))
    assert browser.find_element("id", "video").is_displayed()
    browser.find_element("id", "video-close").click()
    assert not browser.find_element("id", "video").is_displayed()


def test_what_is_no_video_is_said_to_be_none(browser: Any) -> None:
    browser.execute_async_script(DROP_FILE, base64.b64encode(b"no video at all").decode(), "clip.mp4")
    until(lambda: "a video that this browser can play" in said(browser))
    assert "got clip.mp4" in said(browser) and not browser.find_element("id", "video").is_displayed()
