"""How far away the walls are in a picture, by the network that ships with naris; it knows noses, but not this one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from naris.core.camera import Intrinsics
from naris.core.results import DepthEstimate
from naris.errors import CheckpointError, ImageError, InputError
from naris.locate.view import views_of
from naris.model.checkpoint import read_tensors
from naris.model.depth import DepthConfig, DepthNetwork
from naris.model.localizer import limited
from naris.model.residual import PATCH

DEPTH_WEIGHTS = Path(__file__).parent / "weights" / "depth.safetensors"
"""The file that ships with naris (`docs/depth_network.md`)."""

SCHEMA = "naris.depth/1"
FOV_DEG = 40.0, 95.0
"""Vertical angles that the network was trained with; of a wider picture the middle is used, a narrower is refused."""

_FRAME_GREY = 14  # as `naris.locate.view`
_FEWEST = 0.25  # of the cells that must show something


@dataclass(frozen=True)
class ErrorShares:
    """What a registration is told of the network's errors, as shares of the median deviation that it claims.

    Attributes:
        scale: of a factor on the whole picture; as errors are, on looks that no training had.
        smooth: of an error that varies slowly over the picture.
        reach_deg: how far that stays alike. Errors are larger and stay alike for longer (`docs/depth_network.md`);
            registrations that were told so were right less often.
        own: what a claim is multiplied with for the deviation of a cell by itself.
    """

    scale: float = 1.3
    smooth: float = 0.6
    reach_deg: float = 22.0
    own: float = 0.15


@dataclass(frozen=True, eq=False)
class DepthEstimator:
    """The network, ready to be asked; make one with `open_depth`."""

    network: DepthNetwork
    shares: ErrorShares = ErrorShares()

    def estimate(self, image: UInt8[np.ndarray, "h w 3"], intrinsics: Intrinsics) -> DepthEstimate:
        """Ranges (mm) along the rays of the picture's middle square, and how sure they are.

        Raises:
            InputError: if the lens is narrower than those that the network knows.
            ImageError: if the picture has not the shape of those that the intrinsics are for, or is black.
        """
        if (narrow := _vertical_deg(intrinsics)) < FOV_DEG[0]:
            raise InputError(
                f"a lens whose picture is at least {FOV_DEG[0]:.0f}° high and wide for a picture alone",
                f"{narrow:.0f}°",
                "check the intrinsics, or give depth",
            )
        size = self.network.config.input_px
        camera = Intrinsics.from_vertical_fov(size, size, angle_deg(intrinsics))
        (view,) = views_of(image, size, camera, intrinsics)
        shown = _in_cells(_shown(view))
        if shown.mean() < _FEWEST:
            raise ImageError(
                "a picture with something in its middle", f"{1 - shown.mean():.0%} of it black", "give another frame"
            )
        log_range, spread = run(self.network, view[None], np.array([size / 2 / camera.fy], np.float32))
        cells = camera.resized(self.network.config.cells, self.network.config.cells)
        return told(np.where(shown, log_range[0], np.nan), spread[0], cells.rays(), self.shares)


def told(
    log_range: Float[np.ndarray, "i j"],
    spread: Float[np.ndarray, "i j"],
    rays: Float[np.ndarray, "i j 3"],
    shares: ErrorShares,
) -> DepthEstimate:
    """What the network said of a picture with its errors taken apart; NaN where nothing is shown."""
    known = np.isfinite(log_range)
    middle = float(np.median(spread[known]))
    return DepthEstimate(
        rays,
        np.exp(log_range),
        np.where(known, shares.own * spread, np.nan),
        shares.smooth * middle,
        shares.reach_deg,
        shares.scale * middle,
    )


def run(
    network: DepthNetwork, images: UInt8[np.ndarray, "b s s 3"], half_height: Float[np.ndarray, "b"]
) -> tuple[Float[np.ndarray, "b i j"], Float[np.ndarray, "b i j"]]:
    """Logarithms of ranges and scales of their errors, as float64."""
    with torch.inference_mode(), limited(1):
        out = network(torch.from_numpy(np.ascontiguousarray(images)), torch.from_numpy(half_height.astype(np.float32)))
    return out.log_range.numpy().astype(np.float64), out.spread.numpy().astype(np.float64)


@lru_cache(maxsize=2)
def open_depth(path: Path = DEPTH_WEIGHTS) -> DepthEstimator:
    """The network of a file.

    Raises:
        CheckpointError: if it is no such file.
    """
    _, tensors = read_tensors(path, SCHEMA, "a depth network", "install naris anew")
    network = DepthNetwork(DepthConfig())
    names = {name for name, value in network.state_dict().items() if value.is_floating_point()}
    try:
        if names != set(tensors):
            raise RuntimeError(f"{len(names ^ set(tensors))} weights more or fewer")
        network.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()}, strict=False)
    except RuntimeError as error:
        raise CheckpointError(f"a depth network in {path.name}", f"another ({error})", "install naris anew") from error
    return DepthEstimator(network.eval())


def angle_deg(intrinsics: Intrinsics) -> float:
    """The vertical angle to look at a picture with: that of its middle square, as far as the network knows it."""
    return min(_vertical_deg(intrinsics), FOV_DEG[1])


def _vertical_deg(intrinsics: Intrinsics) -> float:
    """Of the middle square of a picture; the widest known one where the lens bends its ends out of view."""
    square = intrinsics.squared()
    middle = (square.height - 1) / 2
    ends = square.unproject(np.array([[middle, -0.5], [middle, square.height - 0.5]]))
    angle = float(np.rad2deg(np.arccos(np.clip(ends[0] @ ends[1], -1, 1))))
    return angle if np.isfinite(angle) else FOV_DEG[1]


def _shown(view: UInt8[np.ndarray, "s s 3"]) -> Bool[np.ndarray, "s s"]:
    """Where a view shows something: all but what is black from there to the border."""
    dark = cv2.blur(view.max(axis=2), (3, 3)) < _FRAME_GREY
    _, pieces = cv2.connectedComponents(dark.astype(np.uint8))
    border = np.unique(np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]]))
    return np.asarray(~(dark & np.isin(pieces, border)))


def _in_cells(shown: Bool[np.ndarray, "s s"]) -> Bool[np.ndarray, "i j"]:
    cells = len(shown) // PATCH
    return np.asarray(shown.reshape(cells, PATCH, cells, PATCH).mean(axis=(1, 3)) > 0.5)
