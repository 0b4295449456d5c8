"""The viewer in headless Chromium, for what is measured, tested and pictured of it."""

from __future__ import annotations

import base64
import importlib.util
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from naris.errors import EngineUnavailable

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

NAMES = ("chromium", "chromium-browser", "google-chrome")
LONG_S = 120.0
QUIET = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
"""A browser that asks nothing and calls nobody."""

# A graphics card in software: the same everywhere.
_IN_SOFTWARE = ("--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def browser_path() -> str | None:
    """The browser, if there is one."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


def missing_browser() -> str | None:
    """What of a browser that can be driven is not here; None if nothing."""
    if browser_path() is None or shutil.which("chromedriver") is None:
        return "Chromium and its driver (Debian: chromium, chromium-driver)"
    return None if importlib.util.find_spec("selenium") else "selenium (pip install 'naris[browser]')"


@contextmanager
def chromium(width: int = 1280, height: int = 800, more: Sequence[str] = ()) -> Iterator[Chrome]:
    """A browser without a screen, its window so large, with `more` flags.

    Raises:
        EngineUnavailable: if there is none.
    """
    if lacks := missing_browser():
        raise EngineUnavailable("a browser that can be driven", "none", f"install {lacks}")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = browser_path() or ""
    for flag in (*QUIET, *_IN_SOFTWARE, *more, f"--window-size={width},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(LONG_S)
    try:
        sized(driver, width, height)
        yield driver
    finally:
        driver.quit()


def sized(driver: Chrome, width: int, height: int) -> None:
    """The size of the page itself, whatever the window adds."""
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


@contextmanager
def steering(words: Sequence[str], folder: Path) -> Iterator[tuple[str, float]]:
    """`naris steer` with these words in a folder: its address, and after how many seconds it was there."""
    command = [sys.executable, "-m", "naris", "steer", *words, "--no-browser", "--port", "0", "--json"]
    begun = time.monotonic()
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=errors, text=True) as child,
    ):
        try:
            yield _address(child, errors), time.monotonic() - begun
        finally:
            child.terminate()


def _address(child: subprocess.Popen[str], errors: Any) -> str:
    text = ""
    for line in child.stdout or ():
        text += line
        if line == "}\n":
            return str(json.loads(text)["address"])
    errors.seek(0)
    raise EngineUnavailable("a page of naris steer", errors.read().strip() or "none", "see what it says")


def opened(driver: Chrome, address: str) -> float:
    """Opens the page and waits until it can be steered; gives the seconds that this took."""
    begun = time.monotonic()
    driver.get(address)
    until(lambda: driver.execute_script("return document.documentElement.dataset.ready") == "yes")
    return time.monotonic() - begun


def until(true: Callable[[], object], step_s: float = 0.1) -> None:
    """Waits until something holds.

    Raises:
        TimeoutError: if it does not.
    """
    end = time.monotonic() + LONG_S
    while not true():
        if time.monotonic() > end:
            raise TimeoutError("the page did not come to what was waited for")
        time.sleep(step_s)


def shown(
    driver: Chrome, pose: list[list[float]], fov_deg: float, width: int, height: int | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """What the page draws at a pose, in pixels of a size of its own, square unless a height is given."""
    script = "return naris.picture(arguments[0], arguments[1], arguments[2], arguments[3])"
    url = str(driver.execute_script(script, pose, fov_deg, width, height or width))
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB"))
