"""The vectors of compiled code against numpy, and the noise that is made of them."""

from __future__ import annotations

import numpy as np
from numba import njit

from naris.render import lanes
from naris.render.lanes import (
    any_lane,
    bits,
    choose,
    counting,
    everywhere,
    gather,
    least,
    load,
    load_bytes,
    magnitude,
    most,
    of_bits,
    real,
    same,
    shifted_down,
    sqrt,
    store,
    store_block,
    store_block_of_masks,
    store_block_of_triples,
    store_grey_triples,
    whole,
)
from naris.render.noise import EDGE, STEPS, noise_bank, white_noise

RNG = np.random.default_rng(0)
X, Y = RNG.uniform(-5, 5, 16).astype(np.float32), RNG.uniform(0.5, 5, 16).astype(np.float32)
K, J = RNG.integers(-1000, 1000, 16).astype(np.int32), RNG.integers(0, 16, 16).astype(np.int32)


@njit
def _floats_njit(a, b, out):
    x, y = load(a, 0), load(b, 0)
    store(out, 0, x + y * 2.0 - 1)
    store(out, 16, 3.0 / y - x)
    store(out, 32, -x / y)
    store(out, 48, least(x, y) + most(x, 0.5))
    store(out, 64, sqrt(y) * magnitude(x))
    store(out, 80, choose((x < y) & (x > -1.0), x, 7.0))
    store(out, 96, choose((x <= 0.0) | (y >= 4.0), 0.0, y))
    x += 2
    store(out, 112, x * everywhere(np.float32(0.25)))
    return any_lane(y > 100.0), any_lane(y > 0.0)


def test_floats() -> None:
    out = np.zeros(128, np.float32)
    assert _floats_njit(X, Y, out) == (False, True)
    expected = [
        X + Y * 2 - 1,
        3 / Y - X,
        -X / Y,
        np.minimum(X, Y) + np.maximum(X, 0.5),
        np.sqrt(Y) * np.abs(X),
        np.where((X < Y) & (X > -1), X, 7),
        np.where((X <= 0) | (Y >= 4), 0, Y),
        (X + 2) / 4,
    ]
    assert np.allclose(out.reshape(8, 16), expected, rtol=1e-5, atol=1e-6)


@njit
def _integers_njit(a, b, x, octets, out):
    i, j = load(a, 0), load(b, 0)
    store(out, 0, (i + j) * 3 - 1)
    store(out, 16, (i & 255) | (j << 8))
    store(out, 32, (i ^ j) >> 2)
    store(out, 48, shifted_down(i, 3))
    store(out, 64, choose(i < j, i, -1))
    store(out, 80, gather(a, j))
    store(out, 96, whole(load(x, 0)) + counting(np.int32(5)))
    store(out, 112, bits(load(x, 0)))
    store(out, 128, whole(real(i) * 0.5))
    store(out, 144, load_bytes(octets, 3) + same(7))
    store(out, 160, bits(of_bits(i)))


def test_integers() -> None:
    out, octets = np.zeros(176, np.int32), RNG.integers(0, 256, 32).astype(np.uint8)
    _integers_njit(K, J, X, octets, out)
    expected = [
        (K + J) * 3 - 1,
        (K & 255) | (J << 8),
        (K ^ J) >> 2,
        (K.view(np.uint32) >> 3).view(np.int32),
        np.where(K < J, K, -1),
        K[J],
        np.trunc(X) + np.arange(16) + 5,
        X.view(np.int32),
        np.trunc(K * 0.5),
        octets[3:19].astype(np.int32) + 7,
        K,
    ]
    assert np.array_equal(out.reshape(11, 16), np.array(expected))


@njit
def _blocks_njit(a, b, plane, triples, marks, greys):
    x, y = load(a, 0), load(b, 0)
    store_block(plane, 2, 8, x)
    store_block_of_triples(triples, 3, 24, x, y, x + y)
    store_block_of_masks(marks, 2, 8, x > 0.0)
    store_grey_triples(greys, 1, x * 100.0, y, y + 0.4)


def test_blocks() -> None:
    plane, triples, marks = np.zeros((4, 8), np.float32), np.zeros((4, 8, 3), np.float32), np.zeros((4, 8), np.bool_)
    greys = np.zeros(50, np.uint8)
    _blocks_njit(X, Y, plane.reshape(-1), triples.reshape(-1), marks.reshape(-1), greys)
    assert np.array_equal(plane[:, 2:6], X.reshape(4, 4)) and not plane[:, :2].any() and not plane[:, 6:].any()
    assert np.array_equal(triples[:, 1:5], np.stack([X, Y, X + Y], -1).reshape(4, 4, 3))
    assert np.array_equal(marks[:, 2:6], (X > 0).reshape(4, 4)) and marks.sum() == (X > 0).sum()
    expected = np.clip(np.stack([X * 100, Y, Y + 0.4], -1) + 0.5, 0, 255).astype(np.uint8)
    assert np.array_equal(greys[1:49], expected.ravel()) and greys[0] == greys[49] == 0


def test_every_vector_function_has_a_sentence() -> None:
    public = [name for name in dir(lanes) if isinstance(getattr(lanes, name), type(lanes.load))]
    assert "gather" in public
    for name in public:
        assert name in ("sqrt", "magnitude", "intrinsic") or getattr(lanes, name).__doc__


def test_white_noise_is_white_and_normal() -> None:
    noise = white_noise(5, np.arange(300_000))
    assert abs(noise.mean()) < 0.01 and abs(noise.std() - 1) < 0.01
    assert abs(np.corrcoef(noise[:-1], noise[1:])[0, 1]) < 0.01 and abs(np.corrcoef(noise[:-3], noise[3:])[0, 1]) < 0.01
    other = white_noise(6, np.arange(300_000))
    assert abs(np.corrcoef(noise, other)[0, 1]) < 0.01
    assert abs((noise**4).mean() / 3 - 1) < 0.15  # the kurtosis of a normal, nearly


def test_noise_volumes_have_the_scale_that_they_promise() -> None:
    bank = noise_bank([0, 6])
    for index in (0, 6):
        tissue, relief = bank[index].astype(float) / STEPS
        assert np.abs(tissue[..., :2].mean(axis=(0, 1, 2))).max() < 0.1
        assert np.abs(tissue[..., :2].std(axis=(0, 1, 2)) - 1).max() < 0.15
        assert abs(np.sqrt((relief[..., 1:] ** 2).sum(-1).mean()) - 1) < 0.1
        for field in (tissue[..., 2], relief[..., 0]):
            steps = np.stack([np.roll(field, -1, axis) - field for axis in range(3)])
            near = np.abs(field) < 0.5
            slope = np.sqrt((steps**2).sum(0))[near]
            assert 0.6 < np.median(slope) < 1.5  # about one voxel of distance in a voxel
        wrap = np.abs(tissue[0] - tissue[-1]).mean() / np.abs(tissue[EDGE // 2] - tissue[EDGE // 2 - 1]).mean()
        assert 0.5 < wrap < 2  # the volume repeats without a seam
