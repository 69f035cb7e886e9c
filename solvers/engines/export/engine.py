"""Packages of engines: optional, found or refused with one line."""

import importlib
import importlib.metadata
import importlib.util
from collections.abc import Iterable
from types import ModuleType

from ....harness.mechanics.system import MultibodySystem
from .tree import CUTTABLE


def missing(module: str, wheel: str = "", remedy: str = "pip install 'mbsbench[engines]'") -> str | None:
    """What to do where ``module`` (of the package ``wheel``, if that has another name) is not installed, or None."""
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # planted in sys.modules without a spec
        found = False
    return None if found else f"{wheel or module} is not installed: {remedy}"


def beyond(
    system: MultibodySystem, kinds: Iterable[str] = CUTTABLE, *, springs: bool = True, torsions: bool = False
) -> str | None:
    """What of the system an adapter does not hand to its engine, or None; ``torsions``: springs of hinges."""
    taken = tuple(kinds)
    found = [str(kind) for kind in map(system.joint_kind, range(system.nj)) if kind not in taken]
    found += ["springs"] * (not springs and len(system.spring_k) > 0)
    found += ["torsional springs"] * (not torsions and len(system.torsion_k) > 0)
    found += ["loads"] * (len(system.load_i) > 0) + ["user forces"] * (len(system.user_i) > 0)
    if not found:
        return None
    given = f"it is given {', '.join(taken[:-1])} and {taken[-1]} joints, gravity{' and springs' if springs else ''}"
    return f"{given} only; the system has {', '.join(dict.fromkeys(found))}"


def made_by(name: str) -> str:
    """Name and version, for the notes of a run."""
    return f"{name} {importlib.metadata.version(name)}"


def package(name: str, *parts: str) -> ModuleType:
    """The package with ``parts`` imported."""
    module = importlib.import_module(name)
    for part in parts:
        importlib.import_module(f"{name}.{part}")
    return module
