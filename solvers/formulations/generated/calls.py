"""Calls of machine code by address inside functions that numba compiles."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def call(typing: Any, address: Any, *arrays: Any) -> Any:
    """f(arrays...) of the C function at the int64 ``address``, by pointers to the arrays' first elements; no result."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        values = [builder.extract_value(given[1], k) for k in range(len(signature.args[1]))]
        of = zip(signature.args[1], values, strict=True)
        data = [context.make_array(kind)(context, builder, value).data for kind, value in of]
        function = ir.FunctionType(ir.VoidType(), [x.type for x in data])
        builder.call(builder.inttoptr(given[0], function.as_pointer()), data)
        return context.get_dummy_value()

    return types.void(types.int64, types.Tuple(arrays)), generate
