# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""5×5 convolution + ReLU + 2×2 max-pool as one operation, forward and backward, on the CPU.

Why it exists: in the plain network most of the time goes to gradients of positions that the pooling threw away. Only
the winner of each 2×2 window carries a gradient, and only if ReLU let it pass, so the backward pass here walks
over the winners alone: less than a quarter of the work of a dense convolution. The forward pass keeps four rows of
sums in the first-level cache and never writes the unpooled map.

Layout: pictures are planar (B, C, H, W) for the forward pass, where the inner loop runs along a row; the backward pass
reads and writes interleaved rows (H, W, C), where the 5 taps of all channels are one contiguous piece of 5·C
floats, padded to whole vectors of 16.

The reference is plain torch (`torch.nn.functional.conv2d`, `relu`, `max_pool2d`); `tests/model/test_fused.py`
compares outputs and every gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from torch import Tensor
from torch.autograd import Function

_TAPS = 5
_LANES = 16
_PASSED = 4  # codes 0–3 name the winner of a window; 4 says that ReLU closed it


@intrinsic
def _axpy16(typing_context, target, target_start, source, source_start, factor):  # noqa: ANN001, ANN202
    """target[i : i+16] += factor · source[j : j+16], as one vector operation (float32, one-dimensional arrays)."""
    signature = types.void(target, types.intp, source, types.intp, types.float32)
    vector = ir.VectorType(ir.FloatType(), _LANES)

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
        def pointer(array, start, kind):  # noqa: ANN001, ANN202
            data = context.make_array(kind)(context, builder, array).data
            return builder.bitcast(builder.gep(data, [start]), vector.as_pointer())

        to = pointer(arguments[0], arguments[1], signature.args[0])
        of = pointer(arguments[2], arguments[3], signature.args[2])
        undefined = ir.Constant(vector, ir.Undefined)
        first = builder.insert_element(undefined, arguments[4], ir.Constant(ir.IntType(32), 0))
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)
        factor16 = builder.shuffle_vector(first, undefined, everywhere)
        product = builder.fmul(factor16, builder.load(of, align=4), flags=["contract"])
        builder.store(builder.fadd(product, builder.load(to, align=4), flags=["contract"]), to, align=4)
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True, fastmath=True, error_model="numpy", cache=True)
def _convolve_two(x, weight, bias, o, y, sums):  # noqa: ANN001, ANN202
    """Row y of output channels o and o+1 into sums[0] and sums[1]; x is (C, H, W)."""
    width = x.shape[2] - _TAPS + 1
    first, second = sums[0], sums[1]
    for i in range(width):
        first[i] = bias[o]
        second[i] = bias[o + 1]
    for c in range(x.shape[0]):
        for k in range(_TAPS):
            row = x[c, y + k]
            a, b = weight[o, c, k], weight[o + 1, c, k]
            a0, a1, a2, a3, a4 = a[0], a[1], a[2], a[3], a[4]
            b0, b1, b2, b3, b4 = b[0], b[1], b[2], b[3], b[4]
            for i in range(width):
                s0, s1, s2, s3, s4 = row[i], row[i + 1], row[i + 2], row[i + 3], row[i + 4]
                first[i] += a0 * s0 + a1 * s1 + a2 * s2 + a3 * s3 + a4 * s4
                second[i] += b0 * s0 + b1 * s1 + b2 * s2 + b3 * s3 + b4 * s4


@njit(nogil=True, error_model="numpy", cache=True)
def _pool_row(upper, lower, pooled, winner):  # noqa: ANN001, ANN202
    """The maximum of each 2×2 window, which of the four it was (the first of equals, as torch), and ReLU."""
    for i in range(pooled.shape[0]):
        best, code = upper[2 * i], np.uint8(0)
        if upper[2 * i + 1] > best:
            best, code = upper[2 * i + 1], np.uint8(1)
        if lower[2 * i] > best:
            best, code = lower[2 * i], np.uint8(2)
        if lower[2 * i + 1] > best:
            best, code = lower[2 * i + 1], np.uint8(3)
        if best > 0:
            pooled[i], winner[i] = best, code
        else:
            pooled[i], winner[i] = np.float32(0), np.uint8(_PASSED)


@njit(nogil=True, error_model="numpy", cache=True)
def _forward(x, weight, bias, pooled, winner, low, high):  # noqa: ANN001, ANN202
    """Pictures low…high−1 of x (B, C, H, W) into pooled and winner (B, O, P, Q)."""
    sums = np.empty((2, 2, x.shape[3] + _LANES), np.float32)
    for i in range(low, high):
        for p in range(pooled.shape[2]):
            for o in range(0, weight.shape[0], 2):
                _convolve_two(x[i], weight, bias, o, 2 * p, sums[0])
                _convolve_two(x[i], weight, bias, o, 2 * p + 1, sums[1])
                for j in range(2):
                    _pool_row(sums[0, j], sums[1, j], pooled[i, o + j, p], winner[i, o + j, p])


@njit(nogil=True, error_model="numpy", cache=True)
def _weight_gradient(rows, layout, gradient, winner, weight, bias, part):  # noqa: ANN001, ANN202
    """Gradients of pictures part[0]…part[1]−1, each into its own slice of weight (B, O·5·P) and bias (B, O).

    `rows` (B, ·) are interleaved pictures; `layout` = (floats a row of the picture, C, P floats a padded row of taps).
    """
    stride, channels, padded = layout
    for i in range(part[0], part[1]):
        for p in range(gradient.shape[2]):
            for o in range(gradient.shape[1]):
                total = np.float32(0)
                for q in range(gradient.shape[3]):
                    code = winner[i, o, p, q]
                    if code == _PASSED:
                        continue
                    value = gradient[i, o, p, q]
                    total += value
                    start = (2 * p + (code >> 1)) * stride + (2 * q + (code & 1)) * channels
                    for k in range(_TAPS):
                        for lane in range(0, padded, _LANES):
                            _axpy16(
                                weight[i], (o * _TAPS + k) * padded + lane, rows[i], start + k * stride + lane, value
                            )
                bias[i, o] += total


@njit(nogil=True, error_model="numpy", cache=True)
def _input_gradient(taps, layout, gradient, winner, rows, part):  # noqa: ANN001, ANN202
    """Adds the gradients of those pictures to `rows` (B, ·); `taps` (O·5·P) are the weights, zero in the padding."""
    stride, channels, padded = layout
    for i in range(part[0], part[1]):
        for p in range(gradient.shape[2]):
            for o in range(gradient.shape[1]):
                for q in range(gradient.shape[3]):
                    code = winner[i, o, p, q]
                    if code == _PASSED:
                        continue
                    start = (2 * p + (code >> 1)) * stride + (2 * q + (code & 1)) * channels
                    for k in range(_TAPS):
                        for lane in range(0, padded, _LANES):
                            from_ = (o * _TAPS + k) * padded + lane
                            _axpy16(rows[i], start + k * stride + lane, taps, from_, gradient[i, o, p, q])


class _ConvReluPool(Function):
    """The operation with its gradients, for autograd."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        batch, _, height, width = x.shape
        shape = (batch, weight.shape[0], (height - _TAPS + 1) // 2, (width - _TAPS + 1) // 2)
        pooled, winner = np.empty(shape, np.float32), np.empty(shape, np.uint8)
        _in_parts(batch, lambda *part: _forward(_array(x), _array(weight), _array(bias), pooled, winner, *part))
        ctx.save_for_backward(x, weight)
        ctx.winner = winner
        return torch.from_numpy(pooled)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, Tensor]:
        x, weight = ctx.saved_tensors
        batch, channels, height, width = x.shape
        outputs = weight.shape[0]
        padded = -(-_TAPS * channels // _LANES) * _LANES
        layout, flat = (width * channels, channels, padded), _array(gradient)
        rows = np.zeros((batch, height * width * channels + padded), np.float32)
        of_weight = np.zeros((batch, outputs * _TAPS * padded), np.float32)
        of_bias = np.zeros((batch, outputs), np.float32)

        def weights(low: int, high: int) -> None:
            rows[low:high, :-padded] = x.detach()[low:high].permute(0, 2, 3, 1).reshape(high - low, -1).numpy()
            _weight_gradient(rows, layout, flat, ctx.winner, of_weight, of_bias, (low, high))

        def inputs(low: int, high: int) -> None:
            rows[low:high] = 0
            _input_gradient(taps, layout, flat, ctx.winner, rows, (low, high))

        _in_parts(batch, weights)
        kernel = of_weight.sum(axis=0).reshape(outputs, _TAPS, padded)[:, :, : _TAPS * channels]
        kernel = kernel.reshape(outputs, _TAPS, _TAPS, channels).transpose(0, 3, 1, 2)
        of_input = None
        if ctx.needs_input_grad[0]:
            taps = np.zeros((outputs, _TAPS, padded), np.float32)
            taps[:, :, : _TAPS * channels] = weight.detach().permute(0, 2, 3, 1).reshape(outputs, _TAPS, -1).numpy()
            taps = taps.ravel()
            _in_parts(batch, inputs)
            interleaved = torch.from_numpy(rows[:, :-padded]).reshape(batch, height, width, channels)
            of_input = interleaved.permute(0, 3, 1, 2).contiguous()
        return of_input, torch.from_numpy(np.ascontiguousarray(kernel)), torch.from_numpy(of_bias.sum(axis=0))


def conv_relu_pool(
    x: Float[Tensor, "b c h w"], weight: Float[Tensor, "o c 5 5"], bias: Float[Tensor, "o"]
) -> Float[Tensor, "b o p q"]:
    """max_pool2d(relu(conv2d(x, weight, bias)), 2) in float32 on the CPU, on `torch.get_num_threads()` threads.

    Args:
        x: (B, C, H, W) float32.
        weight: (O, C, 5, 5) float32, O even.
        bias: (O,) float32.

    Returns:
        (B, O, (H−4)//2, (W−4)//2). Gradients do not depend on the number of threads.

    Raises:
        ValueError: if O is odd or the kernel is not 5×5 (a programming error).
    """
    if weight.shape[0] % 2 or weight.shape[2:] != (_TAPS, _TAPS):
        raise ValueError(f"an even number of 5x5 kernels, not {tuple(weight.shape)}")
    result: Tensor = _ConvReluPool.apply(x.contiguous(), weight, bias)
    return result


def _in_parts(count: int, work: Callable[[int, int], object]) -> None:
    """Runs work(low, high) over 0…count−1, one contiguous part a thread."""
    parts = min(torch.get_num_threads(), count)
    if parts <= 1:
        work(0, count)
        return
    edges = [count * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))


def _array(tensor: Tensor) -> Float32[np.ndarray, "..."]:
    return tensor.detach().contiguous().numpy()
