"""Packages of engines: optional, found or refused with one line."""

import importlib
import importlib.metadata
import importlib.util
from types import ModuleType

from ....harness.mechanics.system import MultibodySystem


def missing(module: str, wheel: str = "") -> str | None:
    """What to do where ``module`` (of the package ``wheel``, if that has another name) is not installed, or None."""
    try:
        found = importlib.util.find_spec(module) is not None
    except ValueError:  # planted in sys.modules without a spec
        found = False
    return None if found else f"{wheel or module} is not installed: pip install 'mbsbench[engines]'"


def beyond(system: MultibodySystem, *, torsions: bool = False) -> str | None:
    """What of the system the adapters do not hand to an engine, or None; ``torsions``: springs of hinges are."""
    left = 0 if torsions else len(system.torsion_k)
    if system.is_pinned and not (len(system.load_i) or left or len(system.user_i)):
        return None
    return "engines are given spherical and revolute joints, gravity and springs only"


def made_by(name: str) -> str:
    """Name and version, for the notes of a run."""
    return f"{name} {importlib.metadata.version(name)}"


def package(name: str, *parts: str) -> ModuleType:
    """The package with ``parts`` imported."""
    module = importlib.import_module(name)
    for part in parts:
        importlib.import_module(f"{name}.{part}")
    return module
