# ruff: noqa: ANN001, ANN201, ANN202, ANN204
# mypy: ignore-errors
"""Sixteen numbers at once in numba: vectors of floats, integers and truth values as values of compiled code.

Numba leaves it to LLVM to find out that a loop may be vectorised, and in a loop over a dozen arrays LLVM finds that it
may not. Here the vectors are written down instead: `a * b + c` on `floats` is one instruction for all lanes on any
processor (two or four where its registers are narrower). Only for code under `njit`; there is nothing to call from
Python.

    x = load(array, at)                 16 consecutive elements of a float32 or int32 array
    y = gather(array, index)            array[index] lane by lane
    z = choose(x < 1.0, x, sqrt(y))     lane by lane
    store(array, at, z)

Arrays are C-contiguous, flat in the order of their memory, and not checked for bounds.
"""

from __future__ import annotations

import operator
from typing import no_type_check

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

LANES = 16
_I1, _I8, _I32, _FLOAT = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.FloatType()
_FAST = ("fast",)


class _Vector(types.Type):
    def __init__(self, name: str, element: ir.Type) -> None:
        self.element = element
        super().__init__(name=name)

    @property
    def llvm(self) -> ir.VectorType:
        return ir.VectorType(self.element, LANES)


class _Floats(_Vector):
    pass


class _Ints(_Vector):
    pass


class _Masks(_Vector):
    pass


floats, ints, masks = _Floats("floats16", _FLOAT), _Ints("ints16", _I32), _Masks("masks16", _I1)


@register_model(_Floats)
@register_model(_Ints)
@register_model(_Masks)
class _VectorModel(models.PrimitiveModel):
    @no_type_check
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.llvm)


@no_type_check
def _splat(builder, scalar):
    vector = ir.Constant(ir.VectorType(scalar.type, LANES), ir.Undefined)
    first = builder.insert_element(vector, scalar, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, vector, ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES))


@no_type_check
def _as(context, builder, value, kind, wanted):
    """A scalar in all lanes, in the element type that is wanted; a vector as it is."""
    if isinstance(kind, _Vector):
        return value
    scalar = {floats: types.float32, ints: types.int32, masks: types.boolean}[wanted]
    value = context.cast(builder, value, kind, scalar)
    return _splat(builder, builder.trunc(value, _I1) if wanted is masks and value.type != _I1 else value)


@no_type_check
def _operator(function, operands, result, emit):
    """Makes an operator work on vectors, and on a vector and a number."""

    class Template(AbstractTemplate):
        @no_type_check
        def generic(self, args, kws):
            if operands in args and all(a is operands or isinstance(a, (types.Number, types.Boolean)) for a in args):
                return signature(result, *args)
            return None

    in_place = getattr(operator, f"i{function.__name__.rstrip('_')}", None)
    both = [function] if in_place is None else [function, in_place]
    for one in both:
        infer_global(one)(type("Template", (Template,), {}))

    @no_type_check
    def lower(context, builder, sig, args):
        values = [_as(context, builder, a, t, operands) for a, t in zip(args, sig.args, strict=True)]
        return emit(builder, *values)

    unary = function is operator.neg
    kinds = [(operands,)] if unary else [(operands, operands), (operands, types.Number), (types.Number, operands)]
    for one in both:
        for kind in kinds:
            lower_builtin(one, *kind)(lower)


_operator(operator.add, floats, floats, lambda b, x, y: b.fadd(x, y, flags=_FAST))
_operator(operator.sub, floats, floats, lambda b, x, y: b.fsub(x, y, flags=_FAST))
_operator(operator.mul, floats, floats, lambda b, x, y: b.fmul(x, y, flags=_FAST))
_operator(operator.truediv, floats, floats, lambda b, x, y: b.fdiv(x, y, flags=_FAST))
_operator(operator.neg, floats, floats, lambda b, x: b.fneg(x, flags=_FAST))
for _function, _sign in ((operator.lt, "<"), (operator.gt, ">"), (operator.le, "<="), (operator.ge, ">=")):
    _operator(_function, floats, masks, lambda b, x, y, s=_sign: b.fcmp_ordered(s, x, y, flags=_FAST))
    _operator(_function, ints, masks, lambda b, x, y, s=_sign: b.icmp_signed(s, x, y))
_operator(operator.add, ints, ints, lambda b, x, y: b.add(x, y))
_operator(operator.sub, ints, ints, lambda b, x, y: b.sub(x, y))
_operator(operator.mul, ints, ints, lambda b, x, y: b.mul(x, y))
_operator(operator.and_, ints, ints, lambda b, x, y: b.and_(x, y))
_operator(operator.or_, ints, ints, lambda b, x, y: b.or_(x, y))
_operator(operator.xor, ints, ints, lambda b, x, y: b.xor(x, y))
_operator(operator.lshift, ints, ints, lambda b, x, y: b.shl(x, y))
_operator(operator.rshift, ints, ints, lambda b, x, y: b.ashr(x, y))
_operator(operator.and_, masks, masks, lambda b, x, y: b.and_(x, y))
_operator(operator.or_, masks, masks, lambda b, x, y: b.or_(x, y))


@no_type_check
def _element_type(array):
    return floats if array.dtype is types.float32 else ints


@no_type_check
def _address(context, builder, kind, array, at):
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [at])


@no_type_check
def _each_address(builder, data, index):
    """data + index, lane by lane; llvmlite's own `gep` knows scalars only."""
    step = ir.instructions.GEPInstr(builder.block, data, [index], False, "", source_etype=data.type.pointee)
    step.type = ir.VectorType(data.type, LANES)
    builder._insert(step)
    return step


@no_type_check
def _vector_pointer(builder, pointer, element, lanes=LANES):
    return builder.bitcast(pointer, ir.VectorType(element, lanes).as_pointer())


@no_type_check
def _call(builder, name, result, arguments):
    kind = ir.FunctionType(result, [a.type for a in arguments])
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, arguments, fastmath=_FAST if result == floats.llvm else ())


@intrinsic
@no_type_check
def load(context, array, at):
    """array[at : at + 16] as a vector."""
    result = _element_type(array)

    @no_type_check
    def generate(context, builder, sig, args):
        pointer = _address(context, builder, sig.args[0], args[0], args[1])
        loaded = builder.load(_vector_pointer(builder, pointer, result.element))
        loaded.align = 4
        return loaded

    return result(array, types.intp), generate


@intrinsic
@no_type_check
def load_bytes(context, array, at):
    """array[at : at + 16] of a uint8 array as integers."""

    @no_type_check
    def generate(context, builder, sig, args):
        pointer = _address(context, builder, sig.args[0], args[0], args[1])
        loaded = builder.load(_vector_pointer(builder, pointer, _I8))
        loaded.align = 1
        return builder.zext(loaded, ints.llvm)

    return ints(array, types.intp), generate


@intrinsic
@no_type_check
def store(context, array, at, vector):
    """array[at : at + 16] = vector."""

    @no_type_check
    def generate(context, builder, sig, args):
        pointer = _address(context, builder, sig.args[0], args[0], args[1])
        value = _as(context, builder, args[2], sig.args[2], _element_type(sig.args[0]))
        builder.store(value, _vector_pointer(builder, pointer, value.type.element), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), generate


@no_type_check
def _pick(builder, first, second, lanes):
    return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(_I32, len(lanes)), lanes))


@intrinsic
@no_type_check
def store_block(context, array, at, stride, vector):
    """Four rows of four: lanes 4j … 4j + 3 to array[at + j·stride …]."""

    @no_type_check
    def generate(context, builder, sig, args):
        begin = args[1]
        for j in range(4):
            part = _pick(builder, args[3], args[3], [4 * j + k for k in range(4)])
            pointer = _address(context, builder, sig.args[0], args[0], begin)
            builder.store(part, _vector_pointer(builder, pointer, part.type.element, 4), align=4)
            begin = builder.add(begin, args[2])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, vector), generate


@intrinsic
@no_type_check
def store_block_of_masks(context, array, at, stride, mask):
    """As `store_block` for an array of bool."""

    @no_type_check
    def generate(context, builder, sig, args):
        begin, bytes_ = args[1], builder.zext(args[3], ir.VectorType(_I8, LANES))
        for j in range(4):
            part = _pick(builder, bytes_, bytes_, [4 * j + k for k in range(4)])
            pointer = _address(context, builder, sig.args[0], args[0], begin)
            builder.store(part, _vector_pointer(builder, pointer, _I8, 4), align=1)
            begin = builder.add(begin, args[2])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, mask), generate


@no_type_check
def _interleave(builder, x, y, z, lanes):
    """x, y and z of some lanes, one lane after the other."""
    n, size = len(lanes), x.type.count
    pairs = [lane + size * c for lane in lanes for c in range(2)]
    both = _pick(builder, x, y, pairs)
    third = _pick(builder, z, z, list(lanes) + [lanes[0]] * n)
    order = [v for k in range(n) for v in (2 * k, 2 * k + 1, 2 * n + k)]
    return _pick(builder, both, third, order)


@intrinsic
@no_type_check
def store_block_of_triples(context, array, at, stride, x, y, z):
    """As `store_block` for interleaved triples; `at` and `stride` count elements."""

    @no_type_check
    def generate(context, builder, sig, args):
        begin = args[1]
        for j in range(4):
            part = _interleave(builder, *args[3:], [4 * j + k for k in range(4)])
            pointer = _address(context, builder, sig.args[0], args[0], begin)
            builder.store(part, _vector_pointer(builder, pointer, part.type.element, 12), align=4)
            begin = builder.add(begin, args[2])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, x, y, z), generate


@intrinsic
@no_type_check
def store_grey_triples(context, array, at, x, y, z):
    """Interleaved bytes: 48 elements of a uint8 array from three vectors of grey levels, rounded and clipped."""

    @no_type_check
    def generate(context, builder, sig, args):
        byte = ir.VectorType(_I8, LANES)
        half, low, high = (_splat(builder, ir.Constant(_FLOAT, v)) for v in (0.5, 0.0, 255.0))
        parts = []
        for value in args[2:]:
            rounded = builder.fadd(value, half, flags=_FAST)
            clipped = _least(builder, _most(builder, rounded, low), high)
            parts.append(builder.trunc(builder.fptosi(clipped, ints.llvm), byte))
        joined = _interleave(builder, *parts, list(range(LANES)))
        pointer = _address(context, builder, sig.args[0], args[0], args[1])
        builder.store(joined, _vector_pointer(builder, pointer, _I8, 3 * LANES), align=1)
        return context.get_dummy_value()

    return types.void(array, types.intp, x, y, z), generate


@intrinsic
@no_type_check
def gather(context, array, index):
    """array[index] lane by lane."""
    result = _element_type(array)

    @no_type_check
    def generate(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        pointers = _each_address(builder, data, args[1])
        element = "f32" if result is floats else "i32"
        name = f"llvm.masked.gather.v{LANES}{element}.v{LANES}p0"
        yes = ir.Constant(masks.llvm, [1] * LANES)
        return _call(builder, name, result.llvm, [pointers, ir.Constant(_I32, 4), yes, ir.Constant(result.llvm, None)])

    return result(array, index), generate


@no_type_check
def _least(builder, x, y):
    return builder.select(builder.fcmp_ordered("<", x, y, flags=_FAST), x, y)


@no_type_check
def _most(builder, x, y):
    return builder.select(builder.fcmp_ordered(">", x, y, flags=_FAST), x, y)


@intrinsic
@no_type_check
def least(context, x, y):
    """The smaller one, lane by lane; one of them may be a number."""

    @no_type_check
    def generate(context, builder, sig, args):
        return _least(builder, *(_as(context, builder, a, t, floats) for a, t in zip(args, sig.args, strict=True)))

    return floats(x, y), generate


@intrinsic
@no_type_check
def most(context, x, y):
    """The greater one, lane by lane; one of them may be a number."""

    @no_type_check
    def generate(context, builder, sig, args):
        return _most(builder, *(_as(context, builder, a, t, floats) for a, t in zip(args, sig.args, strict=True)))

    return floats(x, y), generate


@intrinsic
@no_type_check
def choose(context, mask, yes, no):
    """`yes` where the mask is true, else `no`; one of them may be a number."""
    result = ints if all(kind is ints or isinstance(kind, types.Integer) for kind in (yes, no)) else floats

    @no_type_check
    def generate(context, builder, sig, args):
        pair = [_as(context, builder, a, t, result) for a, t in zip(args[1:], sig.args[1:], strict=True)]
        return builder.select(args[0], *pair)

    return result(mask, yes, no), generate


@no_type_check
def _unary_float(name):
    @intrinsic
    @no_type_check
    def function(context, x):
        @no_type_check
        def generate(context, builder, sig, args):
            return _call(builder, f"llvm.{name}.v{LANES}f32", floats.llvm, list(args))

        return floats(x), generate

    return function


sqrt, magnitude = _unary_float("sqrt"), _unary_float("fabs")


@intrinsic
@no_type_check
def whole(context, x):
    """Towards zero, as integers."""

    @no_type_check
    def generate(context, builder, sig, args):
        return builder.fptosi(args[0], ints.llvm)

    return ints(x), generate


@intrinsic
@no_type_check
def real(context, x):
    """Integers as floats."""

    @no_type_check
    def generate(context, builder, sig, args):
        return builder.sitofp(args[0], floats.llvm)

    return floats(x), generate


@intrinsic
@no_type_check
def bits(context, x):
    """The bits of floats as integers."""

    @no_type_check
    def generate(context, builder, sig, args):
        return builder.bitcast(args[0], ints.llvm)

    return ints(x), generate


@intrinsic
@no_type_check
def of_bits(context, x):
    """The floats that bits stand for."""

    @no_type_check
    def generate(context, builder, sig, args):
        return builder.bitcast(args[0], floats.llvm)

    return floats(x), generate


@intrinsic
@no_type_check
def shifted_down(context, x, by):
    """Integers shifted right with zeros coming in."""

    @no_type_check
    def generate(context, builder, sig, args):
        return builder.lshr(args[0], _as(context, builder, args[1], sig.args[1], ints))

    return ints(x, by), generate


@intrinsic
@no_type_check
def everywhere(context, x):
    """A float in all lanes."""

    @no_type_check
    def generate(context, builder, sig, args):
        return _as(context, builder, args[0], sig.args[0], floats)

    return floats(x), generate


@intrinsic
@no_type_check
def same(context, x):
    """An integer in all lanes."""

    @no_type_check
    def generate(context, builder, sig, args):
        return _as(context, builder, args[0], sig.args[0], ints)

    return ints(x), generate


@intrinsic
@no_type_check
def counting(context, start):
    """start, start + 1, … as integers."""

    @no_type_check
    def generate(context, builder, sig, args):
        first = _as(context, builder, args[0], sig.args[0], ints)
        return builder.add(first, ir.Constant(ints.llvm, list(range(LANES))))

    return ints(start), generate


@intrinsic
@no_type_check
def any_lane(context, mask):
    """Whether any lane is true."""

    @no_type_check
    def generate(context, builder, sig, args):
        word = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", word, ir.Constant(word.type, 0))

    return types.boolean(mask), generate
