"""Packages of engines: optional, found or refused with one line."""

import importlib
import importlib.metadata
import importlib.util
from collections.abc import Iterable
from types import ModuleType

from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.time_functions import varies
from .tree import CUTTABLE


def missing(module: str, wheel: str = "", remedy: str = "pip install 'mbsbench[engines]'") -> str | None:
    """What to do where ``module`` (of the package ``wheel``, if that has another name) is not installed, or None."""
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # planted in sys.modules without a spec
        found = False
    return None if found else f"{wheel or module} is not installed: {remedy}"


def beyond(
    system: MultibodySystem, kinds: Iterable[str] = CUTTABLE, *,
    springs: bool = True, torsions: bool = False, loads: str = "none",
) -> str | None:  # fmt: skip
    """What of the system an adapter does not hand to its engine, or None.

    ``torsions``: springs of hinges. ``loads``: none, constant ones, or varying ones, too.
    """
    taken, found = tuple(kinds), dict[str, list[str]]()
    for k, name in enumerate(system.joint_names):
        if system.joint_kind(k) not in taken:
            found.setdefault(str(system.joint_kind(k)), []).append(name)
    for k, body in enumerate(system.load_i):
        varies_here = bool(varies(system.load_factor[k : k + 1])[0])
        if loads == "none" or (loads == "constant" and varies_here):
            what = "a load that varies" if varies_here else "a load"
            found.setdefault(what, []).append(f"on {system.body_names[body]}")
    words = [f"{what} ({', '.join(dict.fromkeys(names))})" for what, names in found.items()]
    words += ["springs"] * (not springs and len(system.spring_k) > 0)
    words += ["torsional springs"] * (not torsions and len(system.torsion_k) > 0)
    words += ["user forces"] * (len(system.user_i) > 0)
    if not words:
        return None
    pushes = {"none": [], "constant": ["constant loads"], "varying": ["loads"]}[loads]
    others = ["gravity", *["springs"] * springs, *pushes]
    given = f"it is given {', '.join(taken[:-1])} and {taken[-1]} joints, {', '.join(others[:-1]) or others[-1]}"
    given += f" and {others[-1]}" * (len(others) > 1)
    return f"{given} only; the system has {', '.join(words)}"


def made_by(name: str) -> str:
    """Name and version, for the notes of a run."""
    return f"{name} {importlib.metadata.version(name)}"


def package(name: str, *parts: str) -> ModuleType:
    """The package with ``parts`` imported."""
    module = importlib.import_module(name)
    for part in parts:
        importlib.import_module(f"{name}.{part}")
    return module
