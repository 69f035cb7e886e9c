"""Code of lanes gives the numbers of code for one."""

import casadi as ca
import numpy as np

from mbsbench.harness.base.generated import Code, Loop
from mbsbench.harness.base.generated.code import print_functions
from mbsbench.harness.lab.shadow.lanes import pack_lanes, unpack_lanes, vectorise_functions
from mbsbench.tests.comparing import assert_same


def test_code_of_lanes_gives_the_numbers_of_code_for_one():
    """With comparisons, which differ from lane to lane, functions of LLVM and of libm, and constants."""
    x = ca.SX.sym("x", 3)
    a, b, c = x[0], x[1], x[2]
    outputs = [ca.atan2(a, b) + 2.5, ca.tan(a * b) / c, ca.if_else(a < b, ca.sin(c), -ca.sqrt(c)), ca.sign(a) * c**0.3]
    ir = print_functions({"f": Loop(rows=[x], stored=[ca.vertcat(*outputs)])})
    given = np.random.default_rng(1).normal(size=(1, 21, 3))
    given[:, :, 2] = np.abs(given[:, :, 2])
    lanes = pack_lanes(given)
    one, many = np.empty((21, 4)), np.empty((lanes.shape[1], 4, lanes.shape[3]))
    for text, rows, out in ((ir, given, one), (vectorise_functions(ir), lanes, many)):
        code = Code(text)
        count = np.array([len(out)])
        code.function("f", 3)(count.ctypes.data, rows.ctypes.data, out.ctypes.data)
    assert_same(unpack_lanes(many[None], 21)[0], one)
    assert_same(unpack_lanes(lanes, 21), given)
