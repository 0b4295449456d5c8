"""How many threads learn fastest on this machine, as busy as it is now."""

from __future__ import annotations

import time

import numpy as np
import torch

from naris.model.compact import Compact, CompactConfig
from naris.model.localizer import limited

_STEPS = 4
_GAIN = 0.9  # more threads must take at most this share of the time, or they are not worth their cores
_LONGEST_S = 3.0


def quicker_threads(config: CompactConfig, most: int, batch: int = 64) -> int:
    """`most` if that many threads go through a network clearly faster than one, else 1.

    A step is many short pieces of work with a barrier after each. Where something else runs on one of the cores, all
    threads wait for the one that shares it, and two threads may take ten times as long as one.
    """
    if most < 2:
        return 1
    network = Compact(4, config).train()
    images = torch.from_numpy(np.random.default_rng(0).integers(0, 256, (batch, *(config.input_px,) * 2, 3), np.uint8))
    _pass(network, images)  # the first one also allocates
    alone_s, together_s = (_mean_s(network, images, threads) for threads in (1, most))
    return most if together_s < _GAIN * alone_s else 1


def _mean_s(network: Compact, images: torch.Tensor, threads: int) -> float:
    with limited(threads):
        start, done = time.perf_counter(), 0
        while done < _STEPS and time.perf_counter() - start < _LONGEST_S:
            _pass(network, images)
            done += 1
        return (time.perf_counter() - start) / done


def _pass(network: Compact, images: torch.Tensor) -> None:
    network(images).region_logits.sum().backward()
