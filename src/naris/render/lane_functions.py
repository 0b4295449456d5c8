# ruff: noqa: ANN001, ANN201
# mypy: ignore-errors
"""Functions of sixteen numbers at once, to the last digit or two of a float: LLVM calls a library lane by lane."""

from __future__ import annotations

import numpy as np
from numba import njit

from naris.render.lanes import bits, choose, least, most, of_bits, real, whole

_LOG2_E, _SQRT_2 = np.float32(np.log2(np.e)), np.float32(np.sqrt(2))
_LN_2_HIGH = np.float32(0.693359375)  # nine bits: exact times any exponent, with or without fused multiply-add
_LN_2_LOW = np.float32(np.log(2) - 0.693359375)
_LEAST, _MOST = np.float32(-86.0), np.float32(86.0)
_ROUNDS, _DOWN = np.float32(128.5), np.int32(128)  # above 0, to round towards zero is to round down
_MANTISSA_BITS, _BIAS = np.int32(23), np.int32(127)
_MANTISSA, _ONE = np.int32(0x7FFFFF), np.int32(0x3F800000)

_inline_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, forceinline=True)


@_inline_njit
def exponential(x):
    """e to the x; of numbers beyond ±86 that of ±86."""
    x = most(least(x, _MOST), _LEAST)
    n = whole(x * _LOG2_E + _ROUNDS) - _DOWN
    t = x - real(n) * _LN_2_HIGH - real(n) * _LN_2_LOW
    value = 1.0 + t * (1.0 + t * (1 / 2 + t * (1 / 6 + t * (1 / 24 + t * (1 / 120 + t * (1 / 720))))))
    return value * of_bits((n + _BIAS) << _MANTISSA_BITS)


@_inline_njit
def logarithm(x):
    """The natural logarithm of normal numbers above 0, by the series of artanh about 1."""
    word = bits(x)
    n, m = (word >> _MANTISSA_BITS) - _BIAS, of_bits((word & _MANTISSA) | _ONE)
    is_high = m > _SQRT_2
    m, n = choose(is_high, m * 0.5, m), choose(is_high, n + 1, n)
    s = (m - 1.0) / (m + 1.0)
    s2 = s * s
    series = 1.0 + s2 * (1 / 3 + s2 * (1 / 5 + s2 * (1 / 7 + s2 * (1 / 9))))
    return real(n) * _LN_2_HIGH + (real(n) * _LN_2_LOW + 2.0 * s * series)
