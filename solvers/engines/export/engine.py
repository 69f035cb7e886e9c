"""Packages of engines, and the elements of a system that an adapter passes to its engine."""

import importlib
import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import ModuleType

from ....harness.mechanics.cut_trees.tree import KINDS
from ....harness.mechanics.naming import name_body
from ....harness.mechanics.system import MultibodySystem
from ....harness.mechanics.time_functions import find_varying

SPRINGS, TORSIONS, LOADS, VARYING, USERS = (
    "springs",
    "torsional springs",
    "constant loads",
    "loads that vary",
    "user forces",
)


@dataclass(frozen=True)
class SupportedElements:
    """Elements that an adapter passes to its engine beside gravity, and by element why it passes no others."""

    kinds: tuple[str, ...] = tuple(KINDS)  # kinds of joints
    springs: bool = True
    torsions: bool = True  # whether torsional springs of hinges are taken
    loads: str = "none"  # none, constant or varying
    lacks: Mapping[str, str] = field(default_factory=dict)

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of all elements of a system that the adapter passes to its engine: joints, springs and loads."""
        forces = {
            SPRINGS: self.springs,
            TORSIONS: self.torsions,
            LOADS: self.loads != "none",
            VARYING: self.loads == "varying",
        }
        return (*map(str, self.kinds), *(name for name, taken in forces.items() if taken))


def refuse_unsupported(system: MultibodySystem, taken: SupportedElements) -> str | None:
    """Return a refusal that lists the elements of ``system`` that an adapter does not pass on, or None.

    ``taken`` are the elements that it passes on, with reasons for those that it does not.
    """
    named, elements = {LOADS: "a load", VARYING: "a load that varies"}, taken.elements
    found = dict[str, list[str]]()
    for k, name in enumerate(system.joint_names):
        found.setdefault(str(system.joint_kind(k)), []).append(name)
    for k, body in enumerate(system.load_i):
        what = VARYING if find_varying(system.load_factor[k : k + 1])[0] else LOADS
        found.setdefault(what, []).append(f"on {name_body(system, int(body))}")
    others = {SPRINGS: system.spring_k, TORSIONS: system.torsion_k, USERS: system.user_i}
    found |= {what: [] for what, some in others.items() if len(some)}
    lacking = {what: names for what, names in found.items() if what not in elements}
    if not lacking:
        return None
    words = [
        named.get(what, what) + (f" ({', '.join(dict.fromkeys(names))})" if names else "")
        for what, names in lacking.items()
    ]
    pushes = {"none": [], "constant": ["constant loads"], "varying": ["loads"]}[taken.loads]
    forces = ["gravity", *["springs"] * taken.springs, *pushes]
    given = f"it is given {', '.join(taken.kinds[:-1])} and {taken.kinds[-1]} joints, "
    given += " and ".join(filter(None, (", ".join(forces[:-1]), forces[-1])))
    reasons = "; ".join(dict.fromkeys(taken.lacks[what] for what in lacking if what in taken.lacks))
    return f"{given} only; the system has {', '.join(words)}" + (f": {reasons}" if reasons else "")


def describe_engine(name: str) -> str:
    """Return "NAME VERSION" of the installed package ``name``, for the notes of a run."""
    return f"{name} {importlib.metadata.version(name)}"


def import_package(name: str, *parts: str) -> ModuleType:
    """Import the package ``name`` and its submodules ``parts``; return the package."""
    module = importlib.import_module(name)
    for part in parts:
        importlib.import_module(f"{name}.{part}")
    return module
