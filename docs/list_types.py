"""Count the types that cross rooms, those of a run and of a verdict, and the lines of the rooms that judge.

    python docs/list_types.py           # the counts
    python docs/list_types.py --all     # and each type, with the rooms that name it

A room is one of the map: a folder of ``harness/``, or ``cli``, ``problems``, ``reports``, ``solvers``, with ``api.py``
and the other files that users import as one. A type crosses if another room imports it. A type is of a run if it has a
run's problem and solver, its specification or its record among its fields; of a verdict if it has a verdict, whether it
holds, limits, reasons or a likeness among its fields, or if its name says so.
"""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import PurePath

from syntax_trees import ROOT, list_nodes, read_modules, read_name  # type: ignore[import-not-found]  # beside this file

JUDGING = ("harness/judge", "harness/lab/kit", "harness/lab/fuzz", "harness/formats/motions", "kit.py")
VERDICT = {"verdict", "holds", "limits", "because", "likeness"}
RUN = re.compile(r"^(?!Callable).*\b(RunSpec|RunRecord)\b")


@dataclass(frozen=True, eq=False)
class Type:
    """A class or an alias of words, by file and name, with the types of its fields as text."""

    path: str
    name: str
    fields: dict[str, str]


def find_room(path: str) -> str:
    """Return the room of a file, such as ``harness/judge``."""
    first, *rest = PurePath(path).parts
    return f"harness/{rest[0]}" if first == "harness" else first if rest else "api"


@cache
def list_types() -> dict[tuple[str, str], Type]:
    """Return the classes and aliases of words (``Literal``) at the top of the modules, by file and name."""
    out = {}
    for module in read_modules():
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                out[module.path, node.name] = Type(module.path, node.name, _list_fields(node))
            elif isinstance(node, ast.Assign) and read_name(getattr(node.value, "value", node)) == "Literal":
                name = read_name(node.targets[0])
                out[module.path, name] = Type(module.path, name, {})
    return out


def _list_fields(node: ast.ClassDef) -> dict[str, str]:
    """Return the fields and properties of a class, each with its type as text."""
    out = {}
    for one in node.body:
        if isinstance(one, ast.AnnAssign):
            out[read_name(one.target)] = ast.unparse(one.annotation)
        elif isinstance(one, ast.FunctionDef) and {read_name(d) for d in one.decorator_list} & {"property"}:
            out[one.name] = ast.unparse(one.returns) if one.returns else ""
    return out


@cache
def _index_modules() -> dict[str, ast.Module]:
    """Return the syntax trees by path."""
    return {m.path: m.tree for m in read_modules()}


def _find_module(path: str, node: ast.ImportFrom) -> str | None:
    """Return the path of the module that an import in the file ``path`` names; None if it is not of the product."""
    parts = list(PurePath(path).parts[: -node.level]) if node.level else []
    parts += (node.module or "").split(".") if node.module else []
    parts = parts[1:] if not node.level and parts[0] == "mbsbench" else parts
    places = ("/".join(parts) + ".py", "/".join([*parts, "__init__.py"]))
    return next((p for p in places if p in _index_modules()), None)


def _resolve(path: str | None, name: str) -> tuple[str, str] | None:
    """Return the file and name of the type that a module defines or hands on as ``name``; None if it has none."""
    if path is None:
        return None
    if (path, name) in list_types():
        return path, name
    for node in _index_modules()[path].body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                source = _find_module(path, node)
                if (alias.asname or alias.name) == name and source != path:  # ``from . import`` names a module
                    return _resolve(source, alias.name)
    return None


@cache
def find_crossing() -> dict[Type, tuple[str, ...]]:
    """Return the types that another room imports, each with these rooms."""
    users: dict[tuple[str, str], set[str]] = defaultdict(set)
    for module in read_modules():
        for node in list_nodes(module.tree):
            for alias in node.names if isinstance(node, ast.ImportFrom) else ():
                key = _resolve(_find_module(module.path, node), alias.name)
                if key and find_room(key[0]) != find_room(module.path):
                    users[key].add(find_room(module.path))
    return {list_types()[key]: tuple(sorted(rooms)) for key, rooms in sorted(users.items())}


def list_run_types() -> list[Type]:
    """Return the types of a run: of its settings, its process, its record, and of several runs."""
    named = [t for t in list_types().values() if {"problem", "solver"} <= t.fields.keys()]
    return named + [t for t in list_types().values() if t not in named and any(map(RUN.search, t.fields.values()))]


def list_verdict_types() -> list[Type]:
    """Return the types of a verdict: its words, and what has them beside what was measured."""
    return [t for t in list_types().values() if VERDICT & t.fields.keys() or t.name.endswith("Verdict")]


def count_lines() -> int:
    """Return the number of lines of the rooms that judge."""
    paths = [ROOT / m.path for m in read_modules() if m.path.startswith(JUDGING)]
    return sum(len(p.read_text(encoding="utf-8").splitlines()) for p in paths)


def describe(*, everything: bool) -> Iterator[str]:
    """Yield the counts and, if ``everything``, each type."""
    crossing, runs, verdicts = find_crossing(), list_run_types(), list_verdict_types()
    yield f"{len(crossing)} types cross rooms, {len(runs)} are of a run, {len(verdicts)} of a verdict"
    yield f"{count_lines()} lines in the rooms that judge"
    if everything:
        yield from (f"crosses: {t.path} {t.name}: {', '.join(rooms)}" for t, rooms in crossing.items())
        yield from (f"run: {t.path} {t.name}" for t in runs)
        yield from (f"verdict: {t.path} {t.name}" for t in verdicts)


if __name__ == "__main__":
    sys.stdout.write("\n".join((*describe(everything="--all" in sys.argv), "")))
