"""Digest the function of each measured column by itself, so that a column added or changed leaves all others current.

A column's digest covers what its declaration gives as ``of`` and ``along``, the definitions of ``harness/columns`` that
these call, each by itself, and the whole modules that they use of other rooms. Its meaning, its head and its places in
tables do not count. What all columns are measured from, the series of a motion, has a digest of its own (``codes``).
"""

import ast
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from .syntax import digest_texts, find_imports, flatten

ROOM = "harness/columns"
DECLARED = f"{ROOM}/declared"  # classes whose fields are columns
NUMBER = ("of", "along")  # arguments of a declaration that make the number
LARGEST = (f"{ROOM}/numbers", "find_largest")  # called for a column that gives no ``of``
Name = tuple[str, str]  # a definition: the path of its module, without suffix, and its name


@dataclass
class _Module:
    """The definitions of a module by name, and what the names that it imports stand for."""

    place: str
    defined: dict[str, list[ast.stmt]] = field(default_factory=dict)
    imported: dict[str, Name] = field(
        default_factory=dict
    )  # by the name used here; of an outside package ("", package)

    def add(self, node: ast.stmt) -> None:
        """Note a statement at the top of the module, under each name that it defines or imports."""
        if isinstance(node, ast.Import | ast.ImportFrom):
            self.imported |= dict(_resolve_import(node, self.place))
            return
        for name in _list_defined(node):
            self.defined.setdefault(name, []).append(node)


def digest_columns(
    root: Path, digest_modules: Callable[..., str], list_versions: Callable[[Iterable[str]], list[str]]
) -> dict[str, str]:
    """Return the digest of the function of each column that the package in ``root`` measures, by the column's name.

    ``digest_modules`` gives the digest of whole modules by their paths, ``list_versions`` the versions of packages.
    """
    modules, digests = dict[str, _Module](), dict[tuple[str, ...], str]()
    out = {}
    for path in sorted((root / DECLARED).glob("*.py")):
        place = f"{DECLARED}/{path.stem}"
        for name, given in _list_declared(_parse(root, place)):
            functions = [k for k in given if k.arg in NUMBER]
            if not functions:
                continue
            begin = {(place, n) for k in functions for n in _list_names(k.value)}
            begin |= set() if any(k.arg == "of" for k in functions) else {LARGEST}
            used, whole, outside = _follow(root, begin, modules)
            texts = [t for k in functions for t in (str(k.arg), *flatten(k.value))]
            texts += [t for module, n in sorted(used) for t in (module, n, *flatten(modules[module].defined[n]))]
            if whole:
                used_whole = tuple(sorted(whole))
                if used_whole not in digests:
                    digests[used_whole] = digest_modules(*used_whole)
                texts.append(digests[used_whole])
            out[name] = digest_texts([*list_versions(outside), *texts])
    return out


def _follow(root: Path, begin: Iterable[Name], modules: dict[str, _Module]) -> tuple[set[Name], set[str], set[str]]:
    """Return all that names use: the definitions of ``ROOM``, whole modules of other rooms, and outside packages.

    ``modules`` are those parsed before; more are added.
    """
    used, whole, outside, seen, waiting = set[Name](), set[str](), set[str](), set[Name](), list(begin)
    while waiting:
        one = waiting.pop()
        place, name = one
        if one in seen:
            continue
        seen.add(one)
        if place not in modules:
            modules[place] = _read_module(root, place)
        module = modules[place]
        if name in module.defined:
            used.add(one)
            waiting += [(place, n) for node in module.defined[name] for n in _list_names(node)]
        elif name in module.imported:
            there, named = module.imported[name]
            if there == "":
                outside.add(named)
            elif there.startswith(f"{ROOM}/"):
                waiting.append((there, named))
            else:
                inside = f"{there}/{named}"
                whole.add(inside if (root / f"{inside}.py").is_file() else there)
    return used, whole, outside


def _read_module(root: Path, place: str) -> _Module:
    """Return the definitions and imports of the module at the path ``place``, without suffix."""
    module = _Module(place)
    for node in _parse(root, place).body:
        module.add(node)
    return module


def _parse(root: Path, place: str) -> ast.Module:
    """Return the syntax tree of a module."""
    return ast.parse((root / f"{place}.py").read_bytes())


def _list_declared(tree: ast.Module) -> Iterator[tuple[str, list[ast.keyword]]]:
    """Yield name and keyword arguments of each column that the classes of a module declare."""
    for scope in tree.body:
        for node in scope.body if isinstance(scope, ast.ClassDef) else ():
            if (
                isinstance(node, ast.AnnAssign)
                and isinstance(node.target, ast.Name)
                and isinstance(node.value, ast.Call)
            ):
                yield node.target.id, node.value.keywords


def _list_defined(node: ast.stmt) -> list[str]:
    """Return the names that a statement at the top of a module defines."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]


def _list_names(node: ast.AST) -> set[str]:
    """Return the names in a node but for those in annotations, whose types shape no number."""
    out, waiting = set[str](), [node]
    while waiting:
        one = waiting.pop()
        if isinstance(one, ast.Name):
            out.add(one.id)
        for name, value in ast.iter_fields(one):
            if name not in ("annotation", "returns"):
                waiting += [v for v in (value if isinstance(value, list) else [value]) if isinstance(v, ast.AST)]
    return out


def _resolve_import(node: ast.Import | ast.ImportFrom, place: str) -> Iterator[tuple[str, Name]]:
    """Yield each name that an import binds in the module ``place``, with what it stands for."""
    for alias in node.names:
        bound = alias.asname or alias.name.split(".")[0]
        single = type(node)(**{**vars(node), "names": [alias]})
        found = list(find_imports(ast.Module([single], []), place.split("/")))
        last = found[-1]
        if last.startswith("/"):
            there, _, named = last[1:].rpartition("/")
            yield bound, (there, named)
        else:
            yield bound, ("", last)
