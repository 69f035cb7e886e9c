"""User forces (``mechanics.user_forces``), called by address: kernels are compiled once for all of them."""

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from .moving import DIFFERENCE, row_of
from .vectors import INNER, add, put, turn_back, turned_by


@intrinsic
def _call(typing, address, t, state, load):
    """law(t, state, load) at the ``address`` of its C function."""

    def generate(context, builder, signature, given):
        double = ir.DoubleType()
        law = ir.FunctionType(ir.VoidType(), [double, double.as_pointer(), double.as_pointer()])
        arrays = zip(signature.args[2:], given[2:], strict=True)
        data = [context.make_array(kind)(context, builder, value).data for kind, value in arrays]
        builder.call(builder.inttoptr(given[0], law.as_pointer()), [given[1], *data])
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, state, load), generate


@njit(**INNER)
def evaluate_law(model, r, R, v, t, i):
    """Fill ``user_load`` with forces on both bodies of user force ``i``, then torques, in space."""
    x = model.user_state
    for e in range(2):
        b = model.user_body[i, e]
        for k in range(3):
            x[3 * e + k] = r[b, k] if b >= 0 else 0.0
            x[24 + 3 * e + k] = v[b, k] if b >= 0 else 0.0
            x[30 + 3 * e + k] = v[b, 3 + k] if b >= 0 else 0.0
            for c in range(3):
                x[6 + 9 * e + 3 * k + c] = R[b, k, c] if b >= 0 else 1.0 * (k == c)
    _call(model.user_law[i], t, x, model.user_load)


@njit(**INNER)
def add_user_forces(model, motion):
    """``wrench`` += forces, and torques about C, in space."""
    for i in range(len(model.user_body)):
        evaluate_law(model, motion.r, motion.R, motion.v, motion.t[0], i)
        for e in range(2):
            b = model.user_body[i, e]
            if b >= 0:
                add(1.0, model.user_load[e], motion.wrench[b])
                add(1.0, model.user_load[2 + e], motion.wrench[b, 3:])


@njit(**INNER)
def add_user_slopes(model, motion, half, saddle):
    """-half d(wrench) by v1, column by column, in ``saddle.blocks``, by central differences."""
    r, R, v, first = motion.r, motion.R, motion.v, len(model.spring_body) - len(model.user_body)
    for i in range(len(model.user_body)):
        for o in range(2):  # the end that moves
            b = model.user_body[i, o]
            if b < 0:
                continue
            T = saddle.T[b]
            Q0, Q1, Q2 = row_of(R, b, 0), row_of(R, b, 1), row_of(R, b, 2)
            for c in range(6):
                rate, place = v[b, c], r[b, c % 3]
                for side in (1.0, -1.0):
                    h = side * DIFFERENCE
                    v[b, c] = rate + h
                    if c < 3:
                        r[b, c] = place + half * h
                    else:
                        turned_by(R[b], (h * T[0, c - 3], h * T[1, c - 3], h * T[2, c - 3]), R[b])
                    evaluate_law(model, r, R, v, motion.t[0], i)
                    v[b, c], r[b, c % 3] = rate, place
                    put(Q0, R[b, 0])
                    put(Q1, R[b, 1])
                    put(Q2, R[b, 2])
                    for e in range(2):  # the end on which it acts
                        other = model.user_body[i, e]
                        if other < 0:
                            continue
                        K = saddle.blocks[saddle.body[other] if e == o else saddle.spring[first + i, e]]
                        weight = -0.5 * half / h
                        add(weight, model.user_load[e], K[:3, c])
                        add(weight, turn_back(R[other], model.user_load[2 + e]), K[3:, c])
