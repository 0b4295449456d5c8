"""Any picture file as RGB, or one clear sentence why not.

The size is read from the header and judged before any pixel is decoded: a few hundred bytes can claim gigabytes.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Integer, UInt8
from PIL import Image, ImageOps, UnidentifiedImageError

from naris.errors import ImageError

LEAST_PX = 16
MOST_PX = 64_000_000
_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP", "GIF", "PPM", "JPEG2000")
_DAMAGED = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error, IndexError)


def read_picture(path: Path, least_px: int = LEAST_PX) -> UInt8[np.ndarray, "h w 3"]:
    """The colours of a picture, upright as its file says, 8 bits a channel.

    Grey pictures get three equal channels, 16 bits are cut to 8, what is transparent is black, and of an animation the
    first picture counts.

    Args:
        path: of one of the kinds in `_FORMATS`. Pillow reads others, some of them by starting another program.
        least_px: of its width and of its height.

    Raises:
        ImageError: if the file is missing, no picture, truncated, or its size is not from `least_px` squared to 64
            megapixels.
    """
    todo = "give a PNG, JPEG, TIFF, BMP or WebP picture"
    if not path.is_file():
        raise ImageError(f"a picture in {path}", "a folder" if path.is_dir() else "no such file", "check the path")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes, which are judged here, and of odd notes that are not used
            with Image.open(path, formats=_FORMATS) as picture:
                _check_size(*picture.size, path.name, least_px)
                return _rgb(picture, path.name)
    except UnidentifiedImageError as error:
        raise ImageError(f"a picture in {path.name}", "a file of another kind", todo) from error
    except Image.DecompressionBombError as error:
        raise ImageError(
            f"a picture of at most {MOST_PX:,} pixels in {path.name}", "a larger one", "resize it"
        ) from error
    except _DAMAGED as error:
        raise ImageError(f"a whole picture in {path.name}", f"a damaged one ({error})", "copy it again") from error


def check_array(image: np.ndarray) -> UInt8[np.ndarray, "h w 3"]:
    """An RGB array as the networks take it.

    Raises:
        ImageError: if it is not (H, W, 3) uint8 of 16×16 pixels or more.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ImageError("pictures as arrays (H, W, 3) of uint8, RGB", f"{image.dtype} {image.shape}", "convert them")
    _check_size(image.shape[1], image.shape[0], "the array")
    return image


def _check_size(width: int, height: int, name: str, least_px: int = LEAST_PX) -> None:
    if min(width, height) < least_px or width * height > MOST_PX:
        raise ImageError(
            f"a picture from {least_px}×{least_px} to {MOST_PX:,} pixels in {name}", f"{width}×{height}", "resize it"
        )


def _rgb(picture: Image.Image, name: str) -> UInt8[np.ndarray, "h w 3"]:
    picture = ImageOps.exif_transpose(picture)
    if picture.mode.startswith("I"):
        return np.repeat(_eight_bits(np.asarray(picture), name)[..., None], 3, axis=2)
    if picture.mode == "F":
        raise ImageError(f"a picture of whole numbers in {name}", "floating-point pixels", "convert it to 8 bits")
    if picture.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in picture.info:
        clear = picture.convert("RGBA")
        picture = Image.alpha_composite(Image.new("RGBA", clear.size, (0, 0, 0, 255)), clear)
    return np.array(picture.convert("RGB"))


def _eight_bits(grey: Integer[np.ndarray, "h w"], name: str) -> UInt8[np.ndarray, "h w"]:
    """The high byte of 16 bits; a picture that never leaves 8 bits is taken as it is."""
    low, high = int(grey.min()), int(grey.max())
    if low < 0 or high > 65_535:
        raise ImageError(f"a picture of 8 or 16 bits in {name}", f"values from {low} to {high}", "convert it")
    return (grey if high < 256 else grey >> 8).astype(np.uint8)
