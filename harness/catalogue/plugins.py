"""Problems and solvers from outside the tree: a Python file, a mechanism's file, an entry point of a package.

Each runs only because it was named: ``--plugin mysolver.py``, or ``--plugin NAME`` with NAME an entry point of the
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

from . import mechanism_files
from .options import nearest

GROUPS = ("mbsbench.problems", "mbsbench.solvers")


def resolve_plugin(plugin: str, beside: Path = Path()) -> str:
    """The full path of a file (found ``beside``), or the name of an entry point as it is."""
    return str((beside / plugin).resolve()) if is_file(plugin) else plugin


def is_file(plugin: str) -> bool:
    """Whether ``plugin`` means a file: names of entry points have no slash and no such ending."""
    return "/" in plugin or plugin.endswith(".py") or mechanism_files.is_mechanism(plugin)


def sources_of(plugin: str) -> tuple[Path, ...]:
    """The files whose content a result depends on; none where there are none to be found."""
    if mechanism_files.is_mechanism(plugin):
        return mechanism_files.files(Path(plugin))
    if is_file(plugin):
        return (Path(plugin),)
    spec = importlib.util.find_spec(_entry_point(plugin).module)
    return (Path(spec.origin),) if spec and spec.origin else ()


def load_plugin(plugin: str) -> Any:
    """A module, a mechanism, or what an entry point names; whatever goes wrong on import is raised."""
    if mechanism_files.is_mechanism(plugin):
        return mechanism_files.read(Path(plugin))
    return _module(Path(plugin)) if is_file(plugin) else _entry_point(plugin).load()


def _module(path: Path) -> ModuleType:
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
    """Those of installed packages, by name; nothing is imported."""
    return {e.name: e for group in GROUPS for e in importlib.metadata.entry_points(group=group)}


def _entry_point(name: str) -> importlib.metadata.EntryPoint:
    known = entry_points()
    if name not in known:
        raise ValueError(f"no file and no entry point of {' or '.join(GROUPS)}{nearest(name, list(known))}")
    return known[name]
