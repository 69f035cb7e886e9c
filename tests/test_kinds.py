"""docs/kinds.toml lists every place of each kind that docs/list_kinds.py finds, and each pattern finds its kind."""

import ast
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs"))
import kind_patterns
import list_kinds
import list_types
import syntax_trees

NEWTON = """
def step(s):
    for _ in range(9):
        r = residual(s)
        {test}
        s.x -= solve(s.J, r)
"""
CROSSING, OF_A_RUN, OF_A_VERDICT = 135, 25, 24
SAMPLES = {  # a text that is of the kind, and one that looks like it
    "spanning trees": (
        "def f(s):\n  queue = [GROUND]\n  for b in queue:\n    queue.extend(near[b])",
        "def f(s):\n  for b in s.bodies:\n    out.append(b)",
    ),
    "tableaus of DOP853": ("a = DOP853.A.copy()", "a = si.DOP853"),
    "steppers of pairs": (
        "def f(y):\n  t = DOP853\n  for a, c in zip(t.a, t.c):\n    k.append(rate(c * h, y + h * a @ k))",
        "def f(a, c):\n  for x in a:\n    y = x + c",
    ),
    "Newton loops": (NEWTON.format(test="if norm(r) < 1e-9: return s.x"), NEWTON.format(test="s.n += s.m < 2")),
    "integration loops": ("while t < t_end:\n    t += h", "while left:\n    left.pop()"),
    "step controllers": ("h = h * min(5.0, 0.9 * error ** (-1.0 / order))", "h = h * error**2"),
    "factorisations": ("lu = splu(K)", "x = lu.solve(b)"),
    "processes to talk to": ("p = subprocess.Popen(call, stdin=pipe)", "p = subprocess.run(call)"),
    "cache folders": ("FOLDER = make_cache_folder('laws', ROOT)", "FOLDER = ROOT / 'laws'"),
    "runs of one run": ("found = solver.solve(problem, control)", "x = np.linalg.solve(A, b)"),
    "lists of presentations": (
        "PARTS = ('split', 'rotation', 'mirror', 'duplicate', 'renumber')",
        "PARTS = ('mirror', 'other')",
    ),
    "observed orders": ("p = [math.log2(a / b) for a, b in pairs]", "bits = math.log2(n)"),
    "cheapest for an error": (
        "near = [r for r in runs if r.error <= target]",
        "near = [r for r in runs if r.error > 0]",
    ),
    "verdicts": (
        "def f(x):\n  return judge_value(x, 'm', most=3.0)",
        "def f(x):\n  return judge_value(x, 'm'), x is Verdict.MET",
    ),
    "limits beside the five measures": (
        "def f(x):\n  return x < 0.1",
        "def f(x):\n  return x < 3.0 and t > end * (1.0 - 1e-9) and len(x) > 0.5",
    ),
    "roads to machine code": ("text = 'define void @f(ptr %x) {'", "'define what f returns'"),
    "private interfaces of libraries": ("from scipy.optimize._numdiff import group_columns", "from ._own import x"),
}


@pytest.mark.sampled(0)
@pytest.mark.beyond_core
def test_every_place_is_listed_and_every_listed_place_is_there():
    faults = list_kinds.list_faults()
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("kind", SAMPLES)
def test_a_pattern_finds_its_kind_alone(kind):
    found = [
        [*kind_patterns.FINDERS[kind](syntax_trees.Module("harness/lab/x.py", ast.parse(text)))]
        for text in SAMPLES[kind]
    ]
    assert found[0], f"{kind}: expected to be found in:\n{SAMPLES[kind][0]}"
    assert not found[1], f"{kind}: expected not to be found in:\n{SAMPLES[kind][1]}, got {found[1]}"


def test_a_new_place_and_a_lost_one_are_faults(monkeypatch):
    found = dict(list_kinds.find_places("Newton loops"))
    lost = found.pop("harness/base/iteration.py iterate")
    found["problems/new.py f"] = syntax_trees.Place("problems/new.py", "f", 7)
    monkeypatch.setattr(list_kinds, "find_places", lambda kind: found if kind == "Newton loops" else known(kind))
    monkeypatch.setattr(list_kinds, "find_by_name", lambda key: None if key == lost.key else lost)
    assert list_kinds.list_faults() == [
        "Newton loops: problems/new.py:7 f is not in docs/kinds.toml",
        f"Newton loops: {lost.key} of docs/kinds.toml is gone",
    ]


def known(kind):
    """Return the places of a kind as listed."""
    return {key: syntax_trees.Place(*key.partition(" ")[::2], 1) for key in list_kinds.read_reasons()[kind]}


def test_reasons_of_independence_are_not_counted():
    reasons = {"": True, "on the rotation group": True, "plain: its equations": False, "other: a unit": False}
    assert {reason: list_kinds.is_counted(reason) for reason in reasons} == reasons


def test_types_cross_no_more_rooms_than_they_do():
    """Whoever adds one takes another away, or raises the number with a reason."""
    assert len(list_types.find_crossing()) <= CROSSING
    assert len(list_types.list_run_types()) <= OF_A_RUN
    assert len(list_types.list_verdict_types()) <= OF_A_VERDICT


def test_a_type_is_found_where_it_is_handed_on():
    """``Status`` is imported from a package that hands it on, by rooms on every floor."""
    rooms = {t.name: rooms for t, rooms in list_types.find_crossing().items()}
    assert {"harness/run", "solvers", "reports"} <= {*rooms["Status"]}
    assert "Trend" not in rooms and "Suite" in rooms
