# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""From light to grey levels, sixteen pixels at once: optics, light meter and sensor of `naris.render.shading`."""

from __future__ import annotations

import numpy as np
from numba import njit

from naris.render.lanes import (
    LANES,
    bits,
    choose,
    counting,
    least,
    load,
    most,
    real,
    shifted_down,
    sqrt,
    store,
    store_block,
    store_grey_triples,
)
from naris.render.look import TONE_REACH, TONE_SIZE
from naris.render.noise import BYTE_SUM_STD
from naris.render.shading import LUMINANCE, METER_BINS, METER_BINS_PER_OCTAVE, METER_FIRST_OCTAVE
from naris.render.wall import lookup

PAD = 16
"""Pixels left and right of each row of a frame's planes."""
_METER_BASE = (127 + METER_FIRST_OCTAVE) * METER_BINS_PER_OCTAVE
_METER_SHIFT = 23 - (METER_BINS_PER_OCTAVE.bit_length() - 1)
_METERED_LANES = (0, 2, 8, 10)
_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False, forceinline=True)
_apart_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False)


@_njit
def expose(camera, row, place, seen, light, scratch):
    """Puts the light of a block behind the optics into the frame, −1 where the round stop is, and meters it."""
    top, left = place
    red, green, blue = light
    at, plane = top * camera.stride + PAD + left, scratch.light.shape[1]
    weight = choose(seen, 1.0, 0.0)
    open_ = seen
    if row.vignette > 0.0 or row.mask_radius >= 0.0:
        half = np.float32(2) / np.float32(camera.height)
        aspect = np.float32(camera.width) / np.float32(camera.height)
        x = (load(camera.column, 0) + (np.float32(left) - np.float32(camera.width - 1) * np.float32(0.5))) * half
        y = (load(camera.row, 0) + (np.float32(top) - np.float32(camera.height - 1) * np.float32(0.5))) * half
        through = most(1.0 - row.vignette / (np.float32(1) + aspect * aspect) * (x * x + y * y), 0.0)
        if row.mask_radius >= 0.0:
            x, y = x - row.mask_x, y - row.mask_y
            edge = (row.mask_radius - sqrt(x * x + y * y)) * (np.float32(1) / row.mask_softness)
            through = through * least(most(edge, 0.0), 1.0)
        weight, open_ = weight * through, through > 0.0
        red, green, blue = red * weight, green * weight, blue * weight
        store(scratch.spill, 0, choose(open_, 1.0, 0.0))
        store_block(scratch.light, at, camera.stride, choose(open_, red, -1.0))
        store_block(scratch.light, at + plane, camera.stride, choose(open_, green, -1.0))
        store_block(scratch.light, at + 2 * plane, camera.stride, choose(open_, blue, -1.0))
    else:
        red, green, blue = red * weight, green * weight, blue * weight
        store(scratch.spill, 0, np.float32(1))
        store_block(scratch.light, at, camera.stride, red)
        store_block(scratch.light, at + plane, camera.stride, green)
        store_block(scratch.light, at + 2 * plane, camera.stride, blue)
    if row.auto > 0.0:
        luminance = np.float32(LUMINANCE[0]) * red + np.float32(LUMINANCE[1]) * green + np.float32(LUMINANCE[2]) * blue
        store(scratch.bins, 0, (bits(luminance) >> _METER_SHIFT) - _METER_BASE)
        for lane in _METERED_LANES:
            inside = left + lane % 4 < camera.width and top + lane // 4 < camera.height
            if inside and scratch.spill[lane] > 0.0:
                scratch.counts[min(max(scratch.bins[lane], 0), METER_BINS - 1)] += 1


@_njit
def _metered(counts, quantile):
    """As `shading.quantile_of_histogram`."""
    total = 0
    for k in range(METER_BINS):
        total += counts[k]
    wanted, below = quantile * total, 0
    for k in range(METER_BINS):
        if below + counts[k] >= wanted:
            if k == 0:
                return 0.0
            octave, step = k // METER_BINS_PER_OCTAVE, k % METER_BINS_PER_OCTAVE
            share = (wanted - below) / max(counts[k], 1)
            return 2.0 ** (METER_FIRST_OCTAVE + octave) * (1 + (step + share) / METER_BINS_PER_OCTAVE)
        below += counts[k]
    return 0.0


@_njit
def _noise(seed, index):
    """As `shading.white_noise`, for sixteen indices."""
    x = index * np.int32(-1640531535) + seed
    x = x ^ shifted_down(x, 16)
    x = x * np.int32(0x7FEB352D)
    x = x ^ shifted_down(x, 15)
    x = x * np.int32(-2073254261)
    x = x ^ shifted_down(x, 16)
    total = (x & 255) + (shifted_down(x, 8) & 255) + (shifted_down(x, 16) & 255) + shifted_down(x, 24)
    return (real(total) - 510.0) * np.float32(1 / BYTE_SUM_STD)


@_njit
def _exposure(row, counts):
    gain = row.gain
    if row.auto > 0.0:
        level = np.float32(_metered(counts, float(row.quantile)))
        automatic = row.target / max(level, np.float32(1e-9))
        gain = gain * min(max(automatic, row.gain_low), row.gain_high) ** row.auto
    return gain


@_apart_njit
def develop(camera, row, tone, seed, i, rgb, scratch):
    """Grey levels of frame i into `rgb`: exposure, tone curve, noise, filter."""
    gain = _exposure(row, scratch.counts)
    gain_r, gain_g, gain_b = gain * row.balance_r, gain * row.balance_g, gain * row.balance_b
    plane, filtered = scratch.light.shape[1], row.tap0 != np.float32(1)
    for y in range(camera.height):
        for x in range(0, camera.width, LANES):
            at, index = y * camera.stride + PAD + x, 3 * (y * camera.width + x)
            red = _grey(tone, i, row, (load(scratch.light, at), gain_r), (seed, index))
            green = _grey(tone, i, row, (load(scratch.light, at + plane), gain_g), (seed, index + 1))
            blue = _grey(tone, i, row, (load(scratch.light, at + 2 * plane), gain_b), (seed, index + 2))
            if filtered:
                store(scratch.grey, at, red)
                store(scratch.grey, at + plane, green)
                store(scratch.grey, at + 2 * plane, blue)
            else:
                _put(camera, rgb, (i, y, x), (red, green, blue), scratch)
    if filtered:
        _along_rows(camera, row, scratch)
        _down_columns(camera, row, i, rgb, scratch)


@_njit
def _grey(tone, i, row, exposed, noise):
    """Grey levels of sixteen pixels of one colour; three indices of noise lie between neighbours."""
    light, gain = exposed
    value = most(light, 0.0) * gain
    if row.clips:
        value = least(value, 1.0) * np.float32(255)
    else:
        at = sqrt(value) * np.float32((TONE_SIZE - 1) / TONE_REACH)
        value = lookup(tone, i * TONE_SIZE, TONE_SIZE, at)
    if row.read_noise > 0.0 or row.shot_noise > 0.0:
        seed, index = noise
        strength = row.read_noise + row.shot_noise * sqrt(value * np.float32(1 / 255))
        value += choose(light < 0.0, 0.0, strength) * _noise(seed, counting(np.int32(0)) * 3 + np.int32(index))
    return value


@_njit
def _put(camera, rgb, place, grey, scratch):
    """Bytes of sixteen pixels of a row, or of fewer at its end."""
    i, y, x = place
    at = 3 * ((i * camera.height + y) * camera.width + x)
    rest = camera.width - x
    if rest >= LANES:
        store_grey_triples(rgb, at, grey[0], grey[1], grey[2])
    else:
        store_grey_triples(scratch.run, 0, grey[0], grey[1], grey[2])
        for k in range(3 * rest):
            rgb[at + k] = scratch.run[k]


@_njit
def _along_rows(camera, row, scratch):
    """The sensor's five taps from `grey` to `light`; the border pixel is repeated."""
    t0, t1, t2, plane, grey = row.tap0, row.tap1, row.tap2, scratch.grey.shape[1], scratch.grey
    for c in range(3):
        for y in range(camera.height):
            first = y * camera.stride + PAD
            last = first + camera.width - 1
            for k in range(1, 3):
                grey[c, first - k], grey[c, last + k] = grey[c, first], grey[c, last]
            for at in range(c * plane + first, c * plane + first + camera.width, LANES):
                near, far = load(grey, at - 1) + load(grey, at + 1), load(grey, at - 2) + load(grey, at + 2)
                store(scratch.light, at, t0 * load(grey, at) + t1 * near + t2 * far)


@_njit
def _down_columns(camera, row, i, rgb, scratch):
    """The same taps down the columns, to bytes."""
    last = camera.height - 1
    for y in range(camera.height):
        lines = (max(y - 2, 0), max(y - 1, 0), y, min(y + 1, last), min(y + 2, last))
        for x in range(0, camera.width, LANES):
            red = _column(camera, row, scratch.light, (lines, x, 0))
            green = _column(camera, row, scratch.light, (lines, x, 1))
            blue = _column(camera, row, scratch.light, (lines, x, 2))
            _put(camera, rgb, (i, y, x), (red, green, blue), scratch)


@_njit
def _column(camera, row, light, place):
    lines, x, c = place
    first = c * light.shape[1] + PAD + x
    near = load(light, first + lines[1] * camera.stride) + load(light, first + lines[3] * camera.stride)
    far = load(light, first + lines[0] * camera.stride) + load(light, first + lines[4] * camera.stride)
    return row.tap0 * load(light, first + lines[2] * camera.stride) + row.tap1 * near + row.tap2 * far
