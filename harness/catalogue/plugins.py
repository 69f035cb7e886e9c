"""Problems and solvers from outside the tree: a Python file, or an entry point of an installed package.

Either runs only because it was named: ``--plugin mysolver.py``, or ``--plugin NAME`` with NAME an entry point of the
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

from .options import nearest

GROUPS = ("mbsbench.problems", "mbsbench.solvers")


def resolved(plugin: str, beside: Path = Path()) -> str:
    """The full path of a file (found ``beside``), or the name of an entry point as it is."""
    return str((beside / plugin).resolve()) if is_file(plugin) else plugin


def is_file(plugin: str) -> bool:
    """Whether ``plugin`` means a file: names of entry points have no slash and no ``.py``."""
    return "/" in plugin or plugin.endswith(".py")


def source_of(plugin: str) -> Path | None:
    """The file whose content a result depends on; None where there is none to be found."""
    if is_file(plugin):
        return Path(plugin)
    spec = importlib.util.find_spec(_entry_point(plugin).module)
    return Path(spec.origin) if spec and spec.origin else None


def loaded(plugin: str) -> Any:
    """The module of a file, or what an entry point names; whatever goes wrong on import is raised."""
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
