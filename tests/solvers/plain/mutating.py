"""Mutants of a Python source, by its syntax tree: every sign and every factor of its functions, turned one at a time.

    sign        a + b and a - b; -a without the sign; += and -=
    factor      a * b without a, without b; a / b without b; *= and /= left out
    number      a coefficient, half as large again
    transposed  multiply and multiply_transposed

Not touched: indices and counts, whatever is compared, messages, declarations of arrays.
"""

import ast
import copy
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

SWAPPED = {"multiply": "multiply_transposed", "multiply_transposed": "multiply"}
OPPOSITE = {ast.Add: ast.Sub, ast.Sub: ast.Add}
# parts of the tree that are no arithmetic of a step
LEFT_OUT = (ast.Compare, ast.JoinedStr, ast.Raise, ast.Assert, ast.arguments, ast.Dict)


class Mutant(NamedTuple):
    """One change of a function of a file, or of a table at its top, where ``function`` is empty."""

    file: str
    function: str
    line: int
    lines: range  # of the statement, by which it is known whether a case meets the change
    change: str
    text: str  # of the line
    tree: ast.stmt  # the function or the statement after the change

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.function or 'table'}: {self.change}"


def list_mutants(path: Path, name: str) -> list[Mutant]:
    """Return all mutants of a source, in the order of its lines; ``name`` is what they call it."""
    found, source = [], path.read_text(encoding="utf-8")
    for prefix, statement in _iterate_statements(ast.parse(source)):
        function = f"{prefix}{statement.name}" if isinstance(statement, ast.FunctionDef) else ""
        nodes = list(_iterate_nodes(statement, statement))
        for at, (node, inner) in enumerate(nodes):
            for change in _list_changes(node):
                tree = copy.deepcopy(statement)
                turned = list(_iterate_nodes(tree, tree))[at][0]
                words = _apply(tree, turned, change)
                lines = range(inner.lineno, (inner.end_lineno or inner.lineno) + 1)
                text = source.splitlines()[node.lineno - 1].strip()
                found.append(Mutant(name, function, node.lineno, lines, words, text, ast.fix_missing_locations(tree)))
    return sorted(found, key=lambda m: m.line)


def _iterate_statements(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Yield functions, methods with the name of their class before them, and assignments at the top."""
    for one in tree.body:
        if isinstance(one, ast.ClassDef):
            yield from ((f"{one.name}.", f) for f in one.body if isinstance(f, ast.FunctionDef))
        elif isinstance(one, ast.FunctionDef | ast.Assign):
            yield "", one


def _iterate_nodes(node: ast.AST, statement: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield nodes that are arithmetic, each with the innermost statement in which it is."""
    yield node, statement
    for name, value in ast.iter_fields(node):
        if name in ("slice", "annotation", "returns", "decorator_list", "test") and not isinstance(node, ast.IfExp):
            continue
        if isinstance(node, ast.For) and name == "iter":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, LEFT_OUT):
                simple = isinstance(child, ast.stmt) and not hasattr(child, "body")
                yield from _iterate_nodes(child, child if simple else statement)


def _is_integer(node: ast.AST) -> bool:
    """Return whether the node is an integer as printed: what is computed with it is a place or a count."""
    return isinstance(node, ast.Constant) and isinstance(node.value, int) and not isinstance(node.value, bool)


def _is_number(node: ast.AST) -> bool:
    """Return whether the node is a coefficient as printed."""
    return isinstance(node, ast.Constant) and isinstance(node.value, float)


def _list_changes(node: ast.AST) -> list[str]:
    """Return the changes of a node by name."""
    if isinstance(node, ast.BinOp) and not (_is_integer(node.left) or _is_integer(node.right)):
        if type(node.op) in OPPOSITE:
            return ["sign"]
        if isinstance(node.op, ast.Mult):
            return [way for way, x in (("no left", node.left), ("no right", node.right)) if not _is_number(x)]
        if isinstance(node.op, ast.Div):
            return [] if _is_number(node.right) else ["no right"]
    if isinstance(node, ast.AugAssign) and not _is_integer(node.value):
        return ["augmented sign" if type(node.op) in OPPOSITE else "left out"]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not _is_integer(node.operand):
        return ["no sign"]
    if _is_number(node) and node.value:  # type: ignore[attr-defined]
        return ["number"]
    return ["swapped"] if isinstance(node, ast.Name) and node.id in SWAPPED else []


def _apply(tree: ast.AST, node: ast.AST, change: str) -> str:
    """Make a change in the tree, in place; return it in words."""
    before, after = ast.unparse(node), node
    if change in ("sign", "augmented sign"):
        node.op = OPPOSITE[type(node.op)]()  # type: ignore[attr-defined]
    elif change in ("no left", "no right"):
        after = node.right if change == "no left" else node.left  # type: ignore[attr-defined]
    elif change == "no sign":
        after = node.operand  # type: ignore[attr-defined]
    elif change == "number":
        node.value *= 1.5  # type: ignore[attr-defined]
    elif change == "swapped":
        node.id = SWAPPED[node.id]  # type: ignore[attr-defined]
    else:
        after = ast.Pass()
    if after is not node:
        ast.copy_location(after, node)
        for parent in ast.walk(tree):
            for name, value in ast.iter_fields(parent):
                if value is node:
                    setattr(parent, name, after)
                elif isinstance(value, list) and any(x is node for x in value):
                    value[:] = [after if x is node else x for x in value]
    return f"{before} -> {ast.unparse(after)}"
