"""Read the syntax trees of modules: what they import, and a form of them that only code changes."""

import ast
import hashlib
from collections.abc import Iterable, Iterator

# fields in which versions of Python differ for equal code
WITHOUT = frozenset(("ctx", "kind", "type_comment", "type_params", "type_ignores"))
SHAPED = ("Bool", "Complex", "Float", "Inexact", "Int", "Num", "Shaped")  # types of arrays in annotations


def find_imports(tree: ast.AST, place: list[str]) -> Iterator[str]:
    """Yield the modules that a module imports, and the names that it imports from them, as paths.

    A path in this package begins with a slash, ``/harness/base/files``, and the packages that contain it are yielded
    too, since an import runs them. Outside packages are yielded by their first name alone. ``tree`` is the syntax tree
    of the module, ``place`` its own path as a list.
    """
    for node in walk_executed(tree):
        if isinstance(node, ast.Import):
            named = [a.name.split(".") for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = (node.module or "").split(".") if node.module else []
            base = ["mbsbench", *place[: len(place) - node.level], *base] if node.level else base
            named = [base, *([*base, a.name] for a in node.names)]
        else:
            continue
        for parts in named:
            if parts[0] == "mbsbench":
                yield from ("/" + "/".join(parts[1:k]) for k in range(2, len(parts) + 1))
            else:
                yield parts[0]


def walk_executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a syntax tree except those under ``if TYPE_CHECKING``, which never run."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


def flatten(node: object) -> list[str]:
    """Return a syntax tree as texts that are equal in all versions of Python, without docstrings and array shapes."""
    out: list[str] = []
    _append_texts(node, out)
    return out


def _append_texts(node: object, out: list[str]) -> None:
    """Append the texts of a node, list or value of a syntax tree to ``out``, without docstrings and array shapes."""
    if isinstance(node, ast.AST):
        out.append(type(node).__name__)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in SHAPED:
            return
        for name in node._fields:
            value = getattr(node, name, None)
            if value is None or value == [] or name in WITHOUT:
                continue
            out.append(f".{name}")
            _append_texts(value, out)
        out.append(")")
    elif isinstance(node, list):
        for item in node:
            if not (  # a docstring
                isinstance(item, ast.Expr)
                and isinstance(item.value, ast.Constant)
                and isinstance(item.value.value, str)
            ):
                _append_texts(item, out)
    else:
        out.append(f"{type(node).__name__} {node!r}")


def digest_texts(parts: Iterable[str]) -> str:
    """Return the first 16 hexadecimal digits of the sha256 of texts, each ended by a zero byte."""
    return hashlib.sha256("".join(f"{part}\0" for part in parts).encode()).hexdigest()[:16]
