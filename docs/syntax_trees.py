"""Read the syntax trees of the product: modules, the classes and functions in them, and names."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("*.py", *(f"{room}/**/*.py" for room in ("checker", "cli", "harness", "problems", "reports", "solvers")))
Scope = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
Loop = ast.For | ast.While


class Module(NamedTuple):
    """The syntax tree of a file of the product."""

    path: str
    tree: ast.Module


class Place(NamedTuple):
    """A function, class or file (empty ``name``) by path and qualified name."""

    path: str
    name: str
    line: int

    @property
    def key(self) -> str:
        """The path and the name, as they stand in ``kinds.toml``."""
        return f"{self.path} {self.name}".strip()


class Body(NamedTuple):
    """A module, class or function by qualified name, with its own nodes: without those of scopes within it."""

    name: str
    scope: Scope
    own: tuple[ast.AST, ...]


@cache
def read_modules() -> tuple[Module, ...]:
    """Return all modules of the product, by path."""
    paths = sorted({path for room in ROOMS for path in ROOT.glob(room)})
    return tuple(Module(str(p.relative_to(ROOT)), ast.parse(p.read_text(encoding="utf-8"))) for p in paths)


def walk_scopes(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, Scope]]:
    """Yield the module (without a name) and all functions and classes in it, by qualified name."""
    if isinstance(tree, ast.Module):
        yield "", tree
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            name = f"{prefix}{node.name}"
            yield name, node
            yield from walk_scopes(node, f"{name}.")
        else:
            yield from walk_scopes(node, prefix)


def walk_own(scope: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a scope without those of the functions and classes within it."""
    for node in ast.iter_child_nodes(scope):
        yield node
        if not isinstance(node, Scope):
            yield from walk_own(node)


@cache
def list_bodies(tree: ast.Module) -> tuple[Body, ...]:
    """Return all scopes of a module by qualified name, each with its own nodes."""
    return tuple(Body(name, scope, tuple(walk_own(scope))) for name, scope in walk_scopes(tree))


@cache
def list_nodes(tree: ast.Module) -> tuple[ast.AST, ...]:
    """Return all nodes of a module, which is walked once."""
    return tuple(ast.walk(tree))


def read_name(node: ast.AST) -> str:
    """Return the last part of a name: ``solve`` of ``lu.solve``; "" for a node that is not a name."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def list_called_names(node: ast.AST) -> set[str]:
    """Return the names of functions that are called; of ``run(s.entry)`` and ``s.entry.run()`` also ``entry``."""
    out = set()
    for call in ast.walk(node):
        if isinstance(call, ast.Call):
            out.add(read_name(call.func))
            if read_name(call.func) == "run":
                out |= {read_name(a) for a in (*call.args[:1], getattr(call.func, "value", call.func))}
    return out


def list_names(node: ast.AST) -> set[str]:
    """Return the last parts of all names within a node."""
    return {read_name(n) for n in ast.walk(node)}
