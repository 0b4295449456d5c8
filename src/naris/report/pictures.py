"""Pictures inside the page as data URIs, and a colour for every region."""

from __future__ import annotations

import base64
import colorsys
import io
import re

import numpy as np
from jaxtyping import UInt8

from naris.report.markup import Markup, element

_HUES = ("#e69f2e", "#2fa37c", "#3c86cc", "#c86fae", "#d9603b", "#57b5cf", "#8d75d0", "#a8a03a", "#7f8c99")
_SIDE = re.compile(r"\b(left|right)\b[\s:._-]*", re.IGNORECASE)


def region_colours(names: tuple[str, ...]) -> UInt8[np.ndarray, "k 3"]:
    """One sRGB colour a region; `left …` and `right …` of one name share their hue, the left one lighter."""
    bases = list(dict.fromkeys(_SIDE.sub("", name).strip().lower() for name in names))
    colours = []
    for name in names:
        turn = bases.index(_SIDE.sub("", name).strip().lower())
        red, green, blue = (int(_HUES[turn % len(_HUES)][i : i + 2], 16) / 255 for i in (1, 3, 5))
        hue, light, strength = colorsys.rgb_to_hls(red, green, blue)
        side = _SIDE.search(name)
        if side is not None:
            light *= 1.25 if side.group(1).lower() == "left" else 0.72
        light *= 0.8 ** (turn // len(_HUES))
        colours.append([round(255 * c) for c in colorsys.hls_to_rgb(hue, min(light, 0.85), strength)])
    return np.array(colours, dtype=np.uint8).reshape(-1, 3)


def css_colour(colour: UInt8[np.ndarray, "3"]) -> str:
    """The colour as `#rrggbb`."""
    return "#" + "".join(f"{int(c):02x}" for c in colour)


def data_uri(image: UInt8[np.ndarray, "h w c"], most_px: int = 256, quality: int = 82) -> str:
    """An RGB or RGBA picture as WebP in a data URI, shrunk so that its longer side has at most `most_px` pixels."""
    from PIL import Image

    picture = Image.fromarray(image)
    scale = most_px / max(picture.size)
    if scale < 1:
        size = (max(round(picture.width * scale), 1), max(round(picture.height * scale), 1))
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, format="WEBP", quality=quality, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def picture(image: UInt8[np.ndarray, "h w 3"], alt: str, most_px: int = 256) -> Markup:
    """An image element with the picture inside it."""
    height, width = image.shape[:2]
    return element("img", src=data_uri(image, most_px), alt=alt, width=width, height=height)
