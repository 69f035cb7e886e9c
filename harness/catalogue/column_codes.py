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
        """Add a statement at the top of the module, under each name that it defines or imports."""
        if isinstance(node, ast.Import | ast.ImportFrom):
            self.imported |= dict(_resolve_import(node, self.place))
            return
        for name in _list_defined(node):
            self.defined.setdefault(name, []).append(node)


def digest_columns(
    root: Path, digest_modules: Callable[..., str], list_versions: Callable[[Iterable[str]], list[str]]
) -> dict[str, str]:
    """Return a digest of all code that determines the value of each measured column, by column.

    The columns are those that the package at ``root`` declares. A digest covers the column's functions, the definitions
    in ``ROOM`` that they use, whole modules outside ``ROOM``, and the versions of third-party packages. Columns without
    a function are omitted. ``digest_modules(*paths)`` returns one digest of whole modules with all that they import,
    ``list_versions(names)`` the locked versions of packages.
    """
    parsed_modules, module_digests = dict[str, _Module](), dict[tuple[str, ...], str]()
    out = {}
    for path in sorted((root / DECLARED).glob("*.py")):
        place = f"{DECLARED}/{path.stem}"
        for column, keywords in _list_declared(_parse(root, place)):
            functions = [keyword for keyword in keywords if keyword.arg in NUMBER]
            if not functions:
                continue
            begin = {(place, name) for keyword in functions for name in _list_names(keyword.value)}
            if all(keyword.arg != "of" for keyword in functions):
                begin.add(LARGEST)
            used, whole, packages = _collect_used(root, begin, parsed_modules)
            texts = [text for keyword in functions for text in (str(keyword.arg), *flatten(keyword.value))]
            for module, name in sorted(used):
                texts += [module, name, *flatten(parsed_modules[module].defined[name])]
            if whole:
                whole_modules = tuple(sorted(whole))
                if whole_modules not in module_digests:
                    module_digests[whole_modules] = digest_modules(*whole_modules)
                texts.append(module_digests[whole_modules])
            out[column] = digest_texts([*list_versions(packages), *texts])
    return out


def _collect_used(
    root: Path, begin: Iterable[Name], modules: dict[str, _Module]
) -> tuple[set[Name], set[str], set[str]]:
    """Return all that the names ``begin`` use, directly or indirectly.

    These are the definitions in ``ROOM``, the paths of whole modules of other rooms, and the names of outside packages.
    ``modules`` are those parsed before, by path; newly parsed ones are added.
    """
    used, whole, outside, seen, waiting = set[Name](), set[str](), set[str](), set[Name](), list(begin)
    while waiting:
        definition = waiting.pop()
        place, name = definition
        if definition in seen:
            continue
        seen.add(definition)
        if place not in modules:
            modules[place] = _read_module(root, place)
        module = modules[place]
        if name in module.defined:
            used.add(definition)
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
    """Return the names that a statement at the top of a module defines: a function, a class, or variables."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]


def _list_names(node: ast.AST) -> set[str]:
    """Return the names in a node of a syntax tree, except those in annotations, since types shape no number."""
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
    """Yield each name that an import binds in the module ``place``, with the definition that it stands for.

    An outside package is yielded as ("", its name).
    """
    for alias in node.names:
        bound = alias.asname or alias.name.split(".")[0]
        single = type(node)(**{**vars(node), "names": [alias]})
        found = list(find_imports(ast.Module([single], []), place.split("/")))
        last = found[-1]
        if last.startswith("/"):  # a path in this package
            there, _, named = last[1:].rpartition("/")
            yield bound, (there, named)
        else:
            yield bound, ("", last)
