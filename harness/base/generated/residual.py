"""The residual F(t, y, y') that SUNDIALS calls, by a program: a C function that calls no Python."""

from functools import cache

from .code import Code

CHECK_EVERY = 16  # residuals between two checks of the deadline, a power of two
# numbers, addresses of functions and of arrays; ``data_of`` is SUNDIALS' function for the array of a vector
WORK = ("evaluations", "deadline", "data_of", "y", "y_dot", "F", "bytes", "t", "run", "program")


@cache
def compile_residual() -> Code:
    """Return the code of ``residual``, which copies y and y' to our arrays, runs the program and copies F back.

    It is a C function as SUNDIALS calls it; its last argument points to the words of ``WORK``. Every ``CHECK_EVERY``
    calls it checks the deadline, and returns -1 once that is past, else 0.
    """
    loads = []
    for k, name in enumerate(WORK):
        kind = "i64" if name in ("evaluations", "deadline", "bytes") else "ptr"
        loads += [f"  %{name}.at = getelementptr i64, ptr %work, i64 {k}", f"  %{name} = load {kind}, ptr %{name}.at"]
    copy = "  call void @llvm.memcpy.p0.p0.i64(ptr {}, ptr {}, i64 %bytes, i1 false)"
    return Code(
        "\n".join(
            [
                "declare i64 @clock()",
                "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
                "define i32 @residual(double %time, ptr %yy, ptr %yp, ptr %rr, ptr %work) {",
                *loads,
                "  %count = add i64 %evaluations, 1",
                "  store i64 %count, ptr %evaluations.at",
                f"  %phase = and i64 %evaluations, {CHECK_EVERY - 1}",
                "  %due = icmp eq i64 %phase, 0",
                "  br i1 %due, label %look, label %go",
                "look:",
                "  %now = call i64 @clock()",
                "  %late = icmp sgt i64 %now, %deadline",
                "  br i1 %late, label %stop, label %go",
                "stop:",
                "  ret i32 -1",
                "go:",
                "  store double %time, ptr %t",
                "  %yy.data = call ptr %data_of(ptr %yy)",
                copy.format("%y", "%yy.data"),
                "  %yp.data = call ptr %data_of(ptr %yp)",
                copy.format("%y_dot", "%yp.data"),
                "  call void %run(ptr %program)",
                "  %rr.data = call ptr %data_of(ptr %rr)",
                copy.format("%rr.data", "%F"),
                "  ret i32 0",
                "}",
                "",
            ]
        )
    )
