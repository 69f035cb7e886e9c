"""Load problems and solvers from outside the tree: a Python file, a mechanism's file, an entry point of a package.

Each is loaded only because it was named: ``--plugin mysolver.py``, or ``--plugin NAME`` with NAME an entry point of the
groups ``mbsbench.problems`` and ``mbsbench.solvers`` (its value a module, or a marked function or class in one).
"""

import hashlib
import importlib.metadata
import importlib.util
import sys
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

from ..base.hints import suggest_name
from . import mechanism

GROUPS = ("mbsbench.problems", "mbsbench.solvers")  # groups of entry points


def resolve_plugin(plugin: str, beside: Path = Path()) -> str:
    """Return the absolute path of a plugin's file, given relative to ``beside``, or an entry point's name unchanged."""
    return str((beside / plugin).resolve()) if is_path(plugin) else plugin


def is_path(plugin: str) -> bool:
    """Return whether ``plugin`` is a path: names of entry points have no slash and no file extension."""
    return "/" in plugin or plugin.endswith(".py") or mechanism.is_mechanism(plugin)


def list_sources(plugin: str) -> tuple[Path, ...]:
    """Return the files of a plugin on whose content a result depends; empty if none can be found."""
    if mechanism.is_mechanism(plugin):
        return mechanism.list_files(Path(plugin))
    if is_path(plugin):
        return (Path(plugin),)
    spec = importlib.util.find_spec(_find_entry_point(plugin).module)
    return (Path(spec.origin),) if spec and spec.origin else ()


def load_plugin(plugin: str) -> Any:
    """Return the imported module of a Python file, the mechanism in a file, or the object of an entry point.

    Any error of the import is raised.
    """
    if mechanism.is_mechanism(plugin):
        return mechanism.read_mechanism(Path(plugin))
    return _import_file(Path(plugin)) if is_path(plugin) else _find_entry_point(plugin).load()


def _import_file(path: Path) -> ModuleType:
    """Run a Python file as a module with a unique name, and return it; raise ValueError if it is no Python file."""
    name = f"mbsbench_plugin_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
    if not path.is_file():
        beside = get_close_matches(path.name, [p.name for p in path.parent.glob("*.py")], n=1)
        raise ValueError("there is no such file" + (f" - did you mean {beside[0]!r}?" if beside else ""))
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError("it is not a Python file: its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Return the entry points of installed packages by name; nothing is imported."""
    return {e.name: e for group in GROUPS for e in importlib.metadata.entry_points(group=group)}


def _find_entry_point(name: str) -> importlib.metadata.EntryPoint:
    """Return the entry point ``name`` of an installed package, not yet loaded; raise ValueError if there is none."""
    known = entry_points()
    if name not in known:
        raise ValueError(f"no file and no entry point of {' or '.join(GROUPS)}{suggest_name(name, list(known))}")
    return known[name]
