"""Machine code from expressions, against CasADi's own evaluation; kept objects."""

import os
import subprocess
import sys
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from mbsbench.harness.base.generated import Code, Loop, Program, code, compile_functions, printing

a, b = ca.SX.sym("a"), ca.SX.sym("b")
OPERATIONS = {
    "sum": a + b,
    "difference": a - b,
    "product": a * b,
    "quotient": a / b,
    "negative": -a,
    "reciprocal": 1 / a,
    "square": a**2,
    "twice": 2 * a,
    "exp": ca.exp(a),
    "log": ca.log(a),
    "sqrt": ca.sqrt(a),
    "sin": ca.sin(a),
    "cos": ca.cos(a),
    "tan": ca.tan(a),
    "asin": ca.asin(a),
    "acos": ca.acos(a),
    "atan": ca.atan(a),
    "sinh": ca.sinh(a),
    "cosh": ca.cosh(a),
    "tanh": ca.tanh(a),
    "asinh": ca.asinh(a),
    "acosh": ca.acosh(a),
    "atanh": ca.atanh(a),
    "log1p": ca.log1p(a),
    "expm1": ca.expm1(a),
    "erf": ca.erf(a),
    "floor": ca.floor(a),
    "ceil": ca.ceil(a),
    "absolute": ca.fabs(a),
    "sign": ca.sign(a),
    "power": a**b,
    "constant power": a**2.5,
    "atan2": ca.atan2(a, b),
    "hypot": ca.hypot(a, b),
    "least": ca.fmin(a, b),
    "largest": ca.fmax(a, b),
    "fmod": ca.fmod(a, b),
    "remainder": ca.remainder(a, b),
    "copysign": ca.copysign(a, b),
    "less": a < b,
    "at most": a <= b,
    "equal": a == b,
    "not equal": a != b,
    "not": ca.logic_not(a),
    "and": ca.logic_and(a < b, a),
    "or": ca.logic_or(a < b, b < 0),
    "choice": ca.if_else(a < b, ca.sqrt(b - a), a * b),
}
VALUES = (-2.5, -1.0, -0.3, 0.0, 0.3, 0.9, 1.0, 7.25)


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(code, "FOLDER", tmp_path)


def long_function(n: int) -> tuple[ca.SX, ca.SX]:
    """A recurrence of about 4 ``n`` operations; values of its first part are read by its last."""
    x = ca.SX.sym("x", 5)
    steps = [x[k] for k in range(5)]
    for k in range(n):
        steps.append(ca.sin(steps[k] * steps[-1]) + steps[k % 7] / (2 + ca.fabs(steps[-1])))
    return x, ca.vertcat(*steps[-20:], x)


def evaluate(made: Code, name: str, *inputs: np.ndarray, size: int) -> np.ndarray:
    out = np.full(size, 99.0)
    Program([(made.address(name), [*inputs, out])], made).run()
    return out


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_equal_casadis(name):
    """Every operation at values around its branches and outside of its domain, to two roundings of libm."""
    made, reference = (
        compile_functions({"f": ([a, b], [OPERATIONS[name]])}),
        ca.Function("f", [a, b], [OPERATIONS[name]]),
    )
    for x in VALUES:
        for y in VALUES:
            ours = evaluate(made, "f", np.array([x]), np.array([y]), size=1)
            np.testing.assert_allclose(ours, float(reference(x, y)), rtol=5e-16, err_msg=f"{name} of {x}, {y}")


def test_long_code_in_parts_equals_short(monkeypatch):
    """The same operations whatever the parts are: nothing is lost between them; matrices are by columns."""
    x, y = long_function(1000)
    at = np.random.default_rng(1).standard_normal(5)
    expected = np.array(ca.Function("f", [x], [y])(at)).ravel()
    for part in (1500, 37, 10**6):
        monkeypatch.setattr(printing, "PART", part)
        ours = evaluate(compile_functions({"f": ([x], [y])}), "f", at, size=25)
        np.testing.assert_allclose(ours, expected, rtol=1e-9, err_msg=str(part))  # contraction, grown by the recurrence


def test_the_code_says_which_product_is_contracted(monkeypatch):
    """One rounding where a sum alone reads a product, the first of two; two roundings elsewhere, on every processor."""
    c, d = ca.SX.sym("c"), ca.SX.sym("d")
    out = ca.vertcat(a * b + c, c - a * c, b * d - a, b * c * d + c * c * d, c * d + a, c * d + b)
    x = {"a": 1.1, "b": 1.3, "c": -1.43, "d": 0.7}

    def fused(p: float, q: float, r: float) -> float:
        return float(Fraction(p) * Fraction(q) + Fraction(r))

    expected = [
        fused(x["a"], x["b"], x["c"]),
        fused(-x["a"], x["c"], x["c"]),
        fused(x["b"], x["d"], -x["a"]),
        fused(x["b"] * x["c"], x["d"], x["c"] * x["c"] * x["d"]),
        x["c"] * x["d"] + x["a"],
        x["c"] * x["d"] + x["b"],
    ]
    assert expected[0] != x["a"] * x["b"] + x["c"]  # else nothing would be told apart
    for part in (1500, 10**6):
        monkeypatch.setattr(printing, "PART", part)
        text = printing.print_module({"f": printing.GeneratedFunction([a, b, c, d], [out])})
        assert "contract" not in text and text.count("call double @llvm.fma") == 4
        made = compile_functions({"f": ([a, b, c, d], [out])})
        assert evaluate(made, "f", *(np.array([v]) for v in x.values()), size=6).tolist() == expected


def test_parts_that_pass_no_number_on_compile(monkeypatch):
    """Each output is an operation of its own: the array between parts is empty, and still an argument of each."""
    monkeypatch.setattr(printing, "PART", 1)
    made = compile_functions({"f": ([a, b], [ca.vertcat(a * b, a - b, ca.sin(a))])})
    ours = evaluate(made, "f", np.array([0.3]), np.array([0.9]), size=3)
    np.testing.assert_allclose(ours, (0.3 * 0.9, 0.3 - 0.9, np.sin(0.3)), rtol=5e-16)


def test_equal_operations_are_shared_and_unused_ones_dropped():
    """One sine for two, none for what no output reads, and no operation with a constant zero."""
    made = {"f": printing.GeneratedFunction([a, b], [ca.sin(a) * b + ca.sin(a) + 0 * ca.cos(b), ca.sin(a)])}
    text = printing.print_module(made)
    assert text.count("call double @llvm.sin") == 1 and "cos" not in text


@pytest.mark.parametrize("part", [1500, 11])
def test_loops_gather_and_add(part, monkeypatch):
    """Whole arrays, rows, gathered, stored and added at random places, also where two elements add to one place."""
    monkeypatch.setattr(printing, "PART", part)
    w, r, g = ca.SX.sym("w", 2), ca.SX.sym("r", 3), ca.SX.sym("g", 4)
    stored = ca.vertcat(ca.sin(g[0]) * r, w[0] + g[1] * r[2])
    added = ca.vertcat(g * w[1], ca.dot(r, g[:3]), 0)
    made = compile_functions({"f": Loop([w], [r], [g], [stored], [added])})
    random = np.random.default_rng(2)
    n, values = 6, random.standard_normal(9)
    whole, rows = random.standard_normal(2), random.standard_normal((n, 3))
    table, places = random.integers(0, 9, (n, 4)), random.integers(0, 7, (n, 6))
    out, total, expected_total = np.zeros((n, 4)), np.ones(7), np.ones(7)
    arrays = [np.array([n]), whole, rows, values, table, out, total, places]
    Program([(made.address("f"), arrays)], made).run()
    reference = ca.Function("f", [w, r, g], [stored, added])
    for e in range(n):
        own, more = (np.array(x).ravel() for x in reference(whole, rows[e], values[table[e]]))
        np.testing.assert_allclose(out[e], own, rtol=1e-14, atol=1e-15)
        np.add.at(expected_total, places[e], more)
    np.testing.assert_allclose(total, expected_total, rtol=1e-13, atol=1e-14)
    Program([(made.address("f"), [np.zeros(1, dtype=np.int64), *arrays[1:]])], made).run()  # no element
    np.testing.assert_allclose(total, expected_total, rtol=1e-13, atol=1e-14)


def test_a_kept_object_is_loaded_and_a_damaged_one_made_again(monkeypatch, tmp_path):
    """Equal expressions compile once; another expression or processor does again; a damaged file is replaced."""
    compiled = []
    monkeypatch.setattr(code, "_compile", lambda *ir, original=code._compile: compiled.append(1) or original(*ir))

    def value(y: ca.SX = a * b) -> float:
        return float(
            evaluate(compile_functions({"f": ([a, b], [y])}), "f", np.array([3.0]), np.array([4.0]), size=1)[0]
        )

    value()  # and the program's own code
    before = len(compiled)
    assert value() == 12.0 and len(compiled) == before
    assert value(a + b) == 7.0 and len(compiled) == before + 1
    for damage in (b"", b"x" * 40, None):
        for file in tmp_path.glob("*.o"):
            content = file.read_bytes()
            file.write_bytes(content[: len(content) // 2] if damage is None else damage)
        before = len(compiled)
        assert value() == 12.0 and len(compiled) == before + 1
    cpu, features = code.find_llvm_target()
    monkeypatch.setattr(code, "find_llvm_target", lambda: ("x86-64" if cpu != "x86-64" else "core2", features))
    before = len(compiled)
    assert value() == 12.0 and len(compiled) == before + 1


def test_the_objects_unused_for_longest_are_removed(tmp_path):
    """Of ten of 1 kB, with room for eight, the last four used stay; one that is gone meanwhile harms nobody."""
    for k in range(10):
        (tmp_path / f"{k}.o").write_bytes(bytes(1000))
        os.utime(tmp_path / f"{k}.o", (k, k))
    code._remove_oldest(tmp_path, 10_000)
    assert len(list(tmp_path.iterdir())) == 10
    code._remove_oldest(tmp_path, 8_000)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["6.o", "7.o", "8.o", "9.o"]


def test_another_process_finds_the_object(tmp_path):
    """The key is the same in a process of its own, which compiles nothing."""
    script = (
        "import casadi as ca, numpy as np, pathlib, sys\n"
        "from mbsbench.harness.base.generated import Program, code, compile_functions\n"
        "code.FOLDER = pathlib.Path(sys.argv[1])\n"
        "made = []\n"
        "original = code._compile\n"
        "code._compile = lambda *x: made.append(1) or original(*x)\n"
        "x = ca.SX.sym('x', 2)\n"
        "f, out = compile_functions({'f': ([x], [ca.sin(x)])}), np.zeros(2)\n"
        "Program([(f.address('f'), [np.ones(2), out])], f).run()\n"
        "assert out[0] == np.sin(1.0)\n"
        "print(len(made))"
    )
    first, second = (
        subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert (first.strip(), second.strip()) == ("2", "0")


def test_one_process_makes_an_object_while_others_wait_for_it(tmp_path):
    """Three begin at once; each object is made by one of them, and one that is not shared waits for nobody."""
    script = (
        "import pathlib, sys, time\n"
        "from mbsbench.harness.base.generated import code\n"
        "code.FOLDER = pathlib.Path(sys.argv[1])\n"
        "original = code._compile\n"
        "def slow(*x):\n"
        "    time.sleep(1.0)\n"
        "    print('made')\n"
        "    return original(*x)\n"
        "code._compile = slow\n"
        "print('ready', flush=True)\n"
        "sys.stdin.readline()\n"
        "for key in ('shared', sys.argv[2]):\n"
        "    code.Code(lambda: f'define void @f() {{\\n  ret void\\n}}\\n; {key}', key)\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    started = [subprocess.Popen([sys.executable, "-c", script, tmp_path, str(k)], **pipes) for k in range(3)]
    assert [p.stdout.readline() for p in started] == ["ready\n"] * 3
    for p in started:
        p.stdin.write("\n")
        p.stdin.flush()
    made = sorted(p.communicate(timeout=60)[0].count("made") for p in started)
    assert made == [1, 1, 2] and [p.returncode for p in started] == [0, 0, 0]
    assert len(list(tmp_path.glob("*.o"))) == 4


def test_a_process_that_keeps_its_lock_holds_nobody_up_for_long(tmp_path, monkeypatch):
    """It may be stopped: the object is made without it."""
    monkeypatch.setattr(code, "FOLDER", tmp_path)
    monkeypatch.setattr(code, "WAIT", 0.2)
    holds = "import fcntl, sys; f = open(sys.argv[1], 'w'); fcntl.lockf(f, fcntl.LOCK_EX); print(flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", holds, tmp_path / "lock"], **pipes) as holder:
        assert holder.stdout.readline() == "\n"
        code.Code("define void @f() {\n  ret void\n}\n", "kept waiting")
        assert holder.poll() is None and len(list(tmp_path.glob("*.o"))) == 1
        holder.communicate("\n")


def test_what_cannot_be_code_is_refused():
    """Operations without counterpart and names that are not there, in words."""
    with pytest.raises(ValueError, match="no machine code"):
        compile_functions({"f": ([a], [ca.erfinv(a)])})
    with pytest.raises(KeyError, match="no function"):
        compile_functions({"f": ([a], [a])}).address("g")
    with pytest.raises(ValueError, match="contiguous"):
        Program([(0, [np.zeros((4, 4))[::2, ::2]])])
