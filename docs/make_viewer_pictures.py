"""Draws `figures/viewer_….webp`: the page of `naris steer` at two sizes, light and dark, and with painted regions.

    python docs/make_viewer_pictures.py [CT ANATOMY]

The built-in nose with its anatomical regions and three keyframes; with a CT and the folder that `naris anatomy
from-ct` made of it, its slices as well. It needs Chromium with its driver.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.folder import save_anatomy
from naris.bench.browser import chromium, opened, sized, steering, until
from naris.core.anatomy import Anatomy
from naris.core.pose import Pose
from naris.render.keyframes import Keyframes, write_keyframes

FIGURES = Path(__file__).with_name("figures")
SIZES = {"light": (1280, 720), "dark": (2560, 1440)}
AT = (0.25, 0.45, 0.6)
REST_S = 4.0


def main(ct: Path | None = None, folder: Path | None = None) -> None:
    """Draws them."""
    nose = built_in_nose()
    with tempfile.TemporaryDirectory() as work, chromium() as driver:
        save_anatomy(nose, Path(work) / "nose")
        write_keyframes(Keyframes.of(along(nose), nose), Path(work) / "keyframes.json")
        with steering(["nose", "--regions", "anatomical"], Path(work)) as (address, _):
            for theme, (width, height) in SIZES.items():
                sized(driver, width, height)
                opened(driver, address)
                picture(driver, FIGURES / f"viewer_{theme}.webp", theme, along(nose)[1].matrix, 0.35)
            sized(driver, *SIZES["light"])
            opened(driver, address)
            painted(driver)
            picture(driver, FIGURES / "viewer_painted.webp", "light", along(nose)[2].matrix, 0.6)
        if ct is not None and folder is not None:
            with steering([str(folder.resolve()), "--ct", str(ct.resolve())], Path(work) / "nose") as (address, _):
                sized(driver, *SIZES["light"])
                opened(driver, address)
                start = driver.execute_script("return naris.page.start.pose")
                picture(driver, Path(work) / "ct.webp", "dark", np.array(start), 0.0)
                Image.open(Path(work) / "ct.webp").save("out/viewer_ct.png")


def painted(driver: Any) -> None:
    """Brush in hand and a stroke on the wall ahead, under a lens that bends."""
    driver.execute_script(
        "const set = (id, value, kind) => { const one = document.getElementById(id); one.value = value;"
        "one.dispatchEvent(new Event(kind)); };"
        "document.getElementById('brush').click(); set('barrel', 10, 'input'); set('brush-radius', 3.5, 'input');"
        "set('brush-region', 4, 'change'); naris.go(arguments[0]); const at = naris.pose(), {brush} = naris.page;"
        "const ahead = k => [0, 1, 2].map(i => at[i][3] + 7 * at[i][2] + 1.2 * k * at[i][1]);"
        "brush.begin(ahead(-4)); for (let k = -3; k <= 4; k++) brush.move(ahead(k)); brush.end()",
        along(built_in_nose())[2].matrix.tolist(),
    )
    until(lambda: not driver.execute_script("return document.getElementById('brush-undo').disabled"))


def along(nose: Anatomy) -> Pose:
    """Along the first passage."""
    line = nose.passages[0].points_mm
    at = (np.array(AT) * len(line)).astype(int)
    return Pose.look(line[at], line[at + 8] - line[at], np.array([0.0, 0.0, 1.0]), nose.frame)


def picture(driver: Any, out: Path, theme: str, pose: np.ndarray, tint: float) -> None:
    """The page as it is with the scope at a pose, and walls coloured by region as strongly as `tint` says."""
    driver.execute_script(
        "if (document.documentElement.dataset.theme !== arguments[0]) document.getElementById('theme').click();"
        "const slider = document.getElementById('tint');"
        "slider.value = 100 * arguments[1]; slider.dispatchEvent(new Event('input')); naris.go(arguments[2])",
        theme,
        tint,
        pose.tolist(),
    )
    thumbnails = "return [...document.querySelectorAll('#strip img')].every(one => one.naturalWidth > 0)"
    until(lambda: driver.execute_script(thumbnails))
    time.sleep(REST_S)
    shot = Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")
    shot.thumbnail((1600, 1600), Image.Resampling.LANCZOS)
    shot.save(out, quality=82, method=6)
    print(out)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
