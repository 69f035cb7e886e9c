"""Find things of one kind by patterns of syntax trees (docs/list_kinds.py lists them)."""

import ast
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache

from syntax_trees import (  # type: ignore[import-not-found]  # beside this file
    Loop,
    Module,
    Scope,
    list_bodies,
    list_called_names,
    list_names,
    list_nodes,
    read_modules,
    read_name,
)

Found = Iterator[tuple[str, int]]


def find_spanning_trees(module: Module) -> Found:
    """Find functions that follow joints from the ground outwards: a loop over a list of bodies that grows in it."""
    for name, scope, _ in list_bodies(module.tree):
        if isinstance(scope, ast.FunctionDef) and "GROUND" in list_names(scope):
            for loop in [n for n in ast.walk(scope) if isinstance(n, Loop)]:
                over = read_name(loop.test if isinstance(loop, ast.While) else loop.iter)
                if over and list_called_names(loop) & {
                    "append",
                    "extend",
                    "insert",
                    "pop",
                    "popleft",
                    "visit",
                    "follow",
                }:
                    yield name, scope.lineno


def find_tableaus(module: Module) -> Found:
    """Find scopes that read the coefficients of DOP853 from scipy."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if (
                isinstance(node, ast.Attribute)
                and node.attr in ["A", "B", "C", "E3", "E5"]
                and read_name(node.value).lower() == "dop853"
            ):
                yield name, node.lineno


def find_steppers(module: Module) -> Found:
    """Find loops over the stages of a pair: they read weights ``a`` and nodes ``c``, in files that name a tableau."""
    if not any(re.search("dop(ri)?853|tableau", n, re.IGNORECASE) for n in map(read_name, list_nodes(module.tree))):
        return
    for name, _, own in list_bodies(module.tree):
        for loop in [n for n in own if isinstance(n, Loop)]:
            if {"a", "c"} <= list_names(loop):
                yield name, loop.lineno


SOLVES = re.compile(r"_?(solve\w*|lstsq|iterate|correct|push_kept|least\w*|change|step|sweep|newton)")
LEAVES = ast.Break | ast.Return


def find_newton_loops(module: Module) -> Found:
    """Find loops that repeat a solution, or a correction by one, until a test of its size is passed."""
    for name, _, own in list_bodies(module.tree):
        for loop in [n for n in own if isinstance(n, Loop)]:
            repeats = isinstance(loop, ast.While) or "range" in list_called_names(loop.iter)
            sized = any(isinstance(n, ast.Compare) for n in ast.walk(loop)) or list_called_names(loop) & {
                "classify",
                "_judge",
            }
            leaves = isinstance(loop, ast.While) or any(isinstance(n, LEAVES) for n in ast.walk(loop))
            if repeats and sized and leaves and any(SOLVES.fullmatch(n) for n in list_called_names(loop)):
                yield name, loop.lineno


UNTIL = re.compile(r"\bt_end\b|\bspan\b|\bt_max\b|\bt <|record\.t\b|\bwanted\b|pace\.choose_step")


def find_integration_loops(module: Module) -> Found:
    """Find loops that continue until a time is reached."""
    for name, _, own in list_bodies(module.tree):
        for loop in own:
            if isinstance(loop, ast.While) and UNTIL.search(ast.unparse(loop.test)):
                yield name, loop.lineno


def find_controllers(module: Module) -> Found:
    """Find powers such as ``error ** (-1 / order)``, by which the next step is chosen."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
                power, base = ast.unparse(node.right), ast.unparse(node.left)
                if "/" in power and re.search("error|size|defect|disagree", base):
                    yield name, node.lineno


FACTORS = {"splu", "cho_factor", "lu_factor", "cholesky", "dpbtrf", "dgbtrf", "ldl"}
FACTORING = re.compile(r"_?(factor|factorise|eliminate)(_\w+)?")


def find_factorisations(module: Module) -> Found:
    """Find calls of libraries' factorisations, and functions named ``factor``, ``factorise`` or ``eliminate``."""
    for name, scope, own in list_bodies(module.tree):
        if isinstance(scope, ast.FunctionDef) and FACTORING.fullmatch(scope.name):
            yield name, scope.lineno
        for node in own:
            if isinstance(node, ast.Call):
                pivoted = read_name(node.func) == "qr" and any(k.arg == "pivoting" for k in node.keywords)
                lapack = read_name(node.func) == "call_lapack" and "trf" in ast.unparse(node.args[0])
                if pivoted or lapack or read_name(node.func) in FACTORS:
                    yield name, node.lineno


def find_protocols(module: Module) -> Found:
    """Find where another process is started to exchange messages with: ``Popen``, ``fork``, ``Process``."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "subprocess.Popen",
                "Popen",
                "os.fork",
                "multiprocessing.Process",
                "Pool",
            ):
                yield name, node.lineno


def find_caches(module: Module) -> Found:
    """Find folders of caches: calls of ``make_cache_folder``, and settings of a folder of numba's."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if isinstance(node, ast.Call) and read_name(node.func) == "make_cache_folder":
                yield name, node.lineno
            if isinstance(node, ast.Assign) and any(read_name(t) == "CACHE_DIR" for t in node.targets):
                yield name, node.lineno


def find_runs_of_one(module: Module) -> Found:
    """Find functions that call ``solve`` of a solver with a problem and its control."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if isinstance(node, ast.Call) and read_name(node.func) in ("solve", "run_one", "solve_repeatedly"):
                words = " ".join(map(ast.unparse, node.args))
                if re.search(r"problem|job|short", words):
                    yield name, node.lineno


PRESENTED = {
    "mirror",
    "duplicate",
    "renumber",
    "unit_length",
    "unit_mass",
    "unit_time",
    "yaw",
    "rotation",
    "retrace",
    "split",
    "weld",
    "perturb",
}


def find_presentations(module: Module) -> Found:
    """Find classes, tables, tuples and calls that name four or more of the presentations of a problem."""
    for name, scope, own in list_bodies(module.tree):
        if isinstance(scope, ast.ClassDef):
            fields = {read_name(n.target) for n in scope.body if isinstance(n, ast.AnnAssign)}
            if len(fields & PRESENTED) >= 4:
                yield name, scope.lineno
        for node in own:
            if isinstance(node, ast.Dict | ast.Tuple | ast.List | ast.Set | ast.Call):
                words = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
                words |= {k.arg for k in node.keywords if k.arg} if isinstance(node, ast.Call) else set()
                if len(words & PRESENTED) >= 4:
                    yield name, node.lineno


LOGARITHMS = {"log", "log2", "log10"}
FITS = {"polyfit", "theilslopes", "linregress"}


def find_orders(module: Module) -> Found:
    """Find powers between numbers: ratios of logarithms, logarithms to 2 of a ratio, fitted lines, 2^order."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            found = False
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                found = all(list_called_names(side) & LOGARITHMS for side in (node.left, node.right))
            elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
                base = node.left.value if isinstance(node.left, ast.Constant) else None
                found = base == 2 and "order" in list_names(node.right)
            elif isinstance(node, ast.Call):
                ratio = any(isinstance(a, ast.BinOp) and isinstance(a.op, ast.Div) for a in ast.walk(node))
                found = read_name(node.func) in FITS or (read_name(node.func) == "log2" and ratio)
            if found:
                yield name, node.lineno


def find_cheapest(module: Module) -> Found:
    """Find selections of what reaches an error: comprehensions whose condition is that an error is at most a number."""
    for name, _, own in list_bodies(module.tree):
        for node in own:
            tests = [t for condition in getattr(node, "ifs", ()) for t in ast.walk(condition)]
            for test in [t for t in tests if isinstance(t, ast.Compare)]:
                error = any("error" in n for n in list_names(test.left))
                if error and isinstance(test.ops[0], ast.LtE):
                    yield name, test.lineno


IR = re.compile(
    r"\b(define|declare) (void|double|i64|i32|linkonce|internal)|= call \w|= getelementptr|@llvm\.|<\{?LANES"
)
ROADS = {"njit", "jit", "cfunc", "CFunc", "intrinsic", "parse_assembly", "IRBuilder", "vectorize"}


def find_compilers(module: Module) -> Found:
    """Find places that compile code: by numba, by LLVM, or from LLVM source text in the file."""
    for node in list_nodes(module.tree):
        called = node.func if isinstance(node, ast.Call) else None
        decorated = node.decorator_list if isinstance(node, ast.FunctionDef) else []
        text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        marks = {read_name(called)} if called else {read_name(d) for d in decorated}
        if marks & ROADS or (IR.search(text) and not is_docstring(node, module.tree)):
            yield "", node.lineno  # type: ignore[attr-defined]


def is_docstring(node: ast.AST, tree: ast.Module) -> bool:
    """Return whether a node is the docstring of a scope of ``tree``."""
    first = (s.body[0] for _, s, _ in list_bodies(tree) if s.body)
    return any(isinstance(f, ast.Expr) and f.value is node for f in first)


INTERNAL = ("numba.core", "numba.np")  # not in numba's documented interface


def find_private_uses(module: Module) -> Found:
    """Find uses of libraries' private names: imports of ``_module``, attributes ``_name`` that no file of ours defines.

    Modules in ``INTERNAL`` and assignments to an attribute of a library count, too.
    """
    ours = list_own_names()
    foreign = {
        a.asname or a.name.partition(".")[0]
        for n in list_nodes(module.tree)
        if isinstance(n, ast.Import)
        for a in n.names
    }
    foreign |= {
        a.asname or a.name
        for n in list_nodes(module.tree)
        if isinstance(n, ast.ImportFrom) and not n.level
        for a in n.names
    }
    for name, _, own in list_bodies(module.tree):
        for node in own:
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            modules += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            modules += (
                [f"{m}.{a.name}" for m in modules for a in node.names] if isinstance(node, ast.ImportFrom) else []
            )
            if any(is_private(part) for m in modules for part in m.split(".")) or any(
                m.startswith(INTERNAL) for m in modules
            ):
                yield name, node.lineno
            if isinstance(node, ast.Attribute) and is_private(node.attr):
                root = node.value
                while isinstance(root, ast.Attribute):
                    root = root.value
                if read_name(root) in foreign or node.attr not in ours:
                    yield name, node.lineno
            targets = node.targets if isinstance(node, ast.Assign) else []
            if any(isinstance(t, ast.Attribute) and read_name(t.value) in foreign - {"sys"} for t in targets):
                yield name, node.lineno


# documented in Python's manual in spite of their names
DOCUMENTED = {"_asdict", "_replace", "_make", "_fields", "_field_defaults", "_exit", "_getframe"}


def is_private(name: str) -> bool:
    """Return whether a name is ``_private`` and not documented in Python's manual."""
    return name.startswith("_") and not name.startswith("__") and name.strip("_") != "" and name not in DOCUMENTED


@cache
def list_own_names() -> set[str]:
    """Return all names that files of the product define."""
    out = set()
    for module in read_modules():
        for node in list_nodes(module.tree):
            if isinstance(node, Scope) and not isinstance(node, ast.Module):
                out.add(node.name)
            elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                out |= (
                    {read_name(node)}
                    if isinstance(node, ast.Name) or read_name(node.value) in ("self", "cls")
                    else set()
                )
    return out


@cache
def list_class_files() -> dict[str, set[str]]:
    """Return the paths of the files that define a public class, by its name."""
    out: dict[str, set[str]] = defaultdict(set)
    for module in read_modules():
        for node in list_nodes(module.tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                out[node.name].add(module.path)
    return out


def find_shared_names(module: Module) -> Found:
    """Find classes whose name a class of another file has too."""
    for name, scope, _ in list_bodies(module.tree):
        if isinstance(scope, ast.ClassDef) and len(list_class_files().get(scope.name, ())) > 1:
            yield name, scope.lineno


VERDICT_WORDS = {"Verdict", "ClaimVerdict", "OracleVerdict", "Behaviour"}


def find_verdicts(module: Module) -> Found:
    """Find files that pass a verdict: a number beside its limits, a reason, or a word of a verdict that is chosen."""
    for _, scope, own in list_bodies(module.tree):
        compared = {id(n) for c in own if isinstance(c, ast.Compare) for n in ast.walk(c)}
        for node in own if isinstance(scope, ast.FunctionDef) else ():
            chosen = isinstance(node, ast.Attribute) and read_name(node.value) in VERDICT_WORDS
            if (chosen and id(node) not in compared) or (isinstance(node, ast.Call) and is_decision(node)):
                yield "", node.lineno  # type: ignore[attr-defined]


def is_decision(call: ast.Call) -> bool:
    """Return whether a call makes a verdict of a number and its limits, or of whether something is good."""
    called, bounded = read_name(call.func), len(call.args) > 2 or any(k.arg in ("most", "least") for k in call.keywords)
    return called == "from_outcome" or (called in ("judge_value", "Reason") and bounded)


JUDGES = (
    "harness/judge/",
    "harness/lab/",
    "harness/formats/motions/",
    "harness/results/",
    "harness/columns/",
    "kit.py",
)
MEASURES = tuple(f"harness/judge/{x}" for x in ("law", "distance", "order", "invariance", "cost", "metrics/"))
ORDERED = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


def find_limits(module: Module) -> Found:
    """Find comparisons with a number, in a room that handles runs, beside the five measures and what they measure.

    Numbers of things and times up to rounding (``t_end * (1.0 - END)``) do not count.
    """
    if module.path.startswith(MEASURES) or not module.path.startswith(JUDGES):
        return
    for name, _, own in list_bodies(module.tree):
        for node in own:
            if isinstance(node, ast.Compare) and any(isinstance(o, ORDERED) for o in node.ops):
                inside = list(ast.walk(node))
                counts = list_called_names(node) & {"len", "random"} or any(map(is_almost_one, inside))
                if not counts and any(map(is_limit, inside)):
                    yield name, node.lineno


def is_limit(node: ast.AST) -> bool:
    """Return whether a node is a number that is neither whole nor zero, or the name of a constant that is one."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, float) and not node.value.is_integer()
    return isinstance(node, ast.Name | ast.Attribute) and read_name(node) in list_limits()


def is_almost_one(node: ast.AST) -> bool:
    """Return whether a node is a sum or difference of 1 and something else, as of a time up to rounding."""
    one = isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant) and node.left.value == 1.0
    return one and isinstance(node.op, ast.Add | ast.Sub)  # type: ignore[attr-defined]


@cache
def list_limits() -> set[str]:
    """Return the names of constants of the product that are numbers with a point, as SMALL = 1e-8."""
    out = set()
    for module in read_modules():
        for node in module.tree.body:
            if isinstance(node, ast.Assign):
                pairs = [(t, node.value) for t in node.targets]
                both = [(t, v) for t, v in pairs if isinstance(t, ast.Tuple) and isinstance(v, ast.Tuple)]
                pairs += [pair for t, v in both for pair in zip(t.elts, v.elts, strict=False)]
                out |= {
                    read_name(t)
                    for t, v in pairs
                    if read_name(t).isupper() and isinstance(v, ast.Constant) and isinstance(v.value, float)
                }
    return out


FINDERS: dict[str, Callable[[Module], Found]] = {
    "spanning trees": find_spanning_trees,
    "tableaus of DOP853": find_tableaus,
    "steppers of pairs": find_steppers,
    "Newton loops": find_newton_loops,
    "integration loops": find_integration_loops,
    "step controllers": find_controllers,
    "factorisations": find_factorisations,
    "processes to talk to": find_protocols,
    "cache folders": find_caches,
    "runs of one run": find_runs_of_one,
    "lists of presentations": find_presentations,
    "observed orders": find_orders,
    "cheapest for an error": find_cheapest,
    "verdicts": find_verdicts,
    "limits beside the five measures": find_limits,
    "roads to machine code": find_compilers,
    "private interfaces of libraries": find_private_uses,
    "names that classes share": find_shared_names,
}
