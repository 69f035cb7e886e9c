"""The referee of constrained multibody dynamics: problems with exact references, solvers, metrics, verdicts.

All that a problem, a solver or a notebook needs is here; the packages below (``mbsbench.harness`` and the rest) may
change. Names are loaded when they are first used.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .harness.base import machine

if TYPE_CHECKING:
    from .api import Results as Results
    from .api import Run as Run
    from .api import load as load
    from .api import scipy as scipy
    from .api import solve as solve
    from .harness.catalogue.functions import StepFailed as StepFailed
    from .harness.catalogue.functions import rhs as rhs
    from .harness.catalogue.functions import step as step
    from .harness.catalogue.making import make_problem as make_problem
    from .harness.catalogue.options import Parameter as Parameter
    from .harness.catalogue.options import option as option
    from .harness.catalogue.registry import problem as problem
    from .harness.catalogue.registry import solver as solver
    from .harness.formats.mechanisms.sympy_systems import read_sympy as read_sympy
    from .harness.mechanics import so3 as so3
    from .harness.mechanics.dynamics import Equations as Equations
    from .harness.mechanics.dynamics import Rates as Rates
    from .harness.mechanics.dynamics import advance as advance
    from .harness.mechanics.jacobian import constraint_jacobian as constraint_jacobian
    from .harness.mechanics.jacobian import independent_rows as independent_rows
    from .harness.mechanics.joints import Joint as Joint
    from .harness.mechanics.joints import JointKind as JointKind
    from .harness.mechanics.joints import MovingKind as MovingKind
    from .harness.mechanics.motion import angular_momentum as angular_momentum
    from .harness.mechanics.motion import constraint as constraint
    from .harness.mechanics.motion import constraint_rate as constraint_rate
    from .harness.mechanics.motion import kinetic_energy as kinetic_energy
    from .harness.mechanics.motion import potential_energy as potential_energy
    from .harness.mechanics.state import State as State
    from .harness.mechanics.state import States as States
    from .harness.mechanics.system import Load as Load
    from .harness.mechanics.system import MultibodySystem as MultibodySystem
    from .harness.mechanics.system import RigidBody as RigidBody
    from .harness.mechanics.system import SpringDamper as SpringDamper
    from .harness.mechanics.system import TorsionSpring as TorsionSpring
    from .harness.mechanics.system import assemble as assemble
    from .harness.mechanics.time_functions import TimeFunction as TimeFunction
    from .harness.mechanics.types import Invariant as Invariant
    from .harness.mechanics.types import Observable as Observable
    from .harness.mechanics.types import Problem as Problem
    from .harness.mechanics.types import Reference as Reference
    from .harness.mechanics.types import Status as Status
    from .harness.mechanics.types import StepControl as StepControl
    from .harness.mechanics.types import Trait as Trait
    from .harness.mechanics.types import Trajectory as Trajectory
    from .harness.mechanics.user_forces import UserForce as UserForce
    from .solvers.formulations.compiled.public import accelerations as accelerations
    from .solvers.formulations.compiled.public import equations as equations
    from .solvers.formulations.compiled.public import project as project

machine.pin_arithmetic()  # before NumPy loads, if it has not yet

_HOMES = {  # the names above for the interpreter, which loads each on first use
    "api": ("Results", "Run", "load", "scipy", "solve"),
    "catalogue.functions": ("StepFailed", "rhs", "step"),
    "catalogue.options": ("Parameter", "option"),
    "catalogue.making": ("make_problem",),
    "catalogue.registry": ("problem", "solver"),
    "formats.mechanisms.sympy_systems": ("read_sympy",),
    "mechanics": ("so3",),
    "mechanics.dynamics": ("Equations", "Rates", "advance"),
    "mechanics.jacobian": ("constraint_jacobian", "independent_rows"),
    "mechanics.motion": ("angular_momentum", "constraint", "constraint_rate", "kinetic_energy", "potential_energy"),
    "mechanics.state": ("State", "States"),
    "mechanics.joints": ("Joint", "JointKind", "MovingKind"),
    "mechanics.system": ("Load", "MultibodySystem", "RigidBody", "SpringDamper", "TorsionSpring", "assemble"),
    "mechanics.user_forces": ("UserForce",),
    "mechanics.time_functions": ("TimeFunction",),
    "mechanics.types": (
        "Invariant",
        "Observable",
        "Problem",
        "Reference",
        "Status",
        "StepControl",
        "Trait",
        "Trajectory",
    ),
    "solvers.formulations.compiled.public": ("accelerations", "equations", "project"),
}
_FORMATS = Path(__file__).parent / "harness" / "formats" / "__init__.py"  # a room that a copy may lack
_HOME = {
    name: module
    for module, names in _HOMES.items()
    for name in names
    if not module.startswith("formats.") or _FORMATS.is_file()
}
__all__ = sorted(_HOME)  # noqa: PLE0605  made of the names above, so that no list is kept twice


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in ("Problem", "make_problem"):  # the first that a notebook may show; solve and load do so themselves
        import_module(".notebook", __name__)
    home = _HOME[name]
    path = f".{home}" if home.startswith(("api", "solvers.")) else f".harness.{home}"
    found = import_module(path, __name__)
    value = import_module(f"{path}.{name}", __name__) if home == "mechanics" else getattr(found, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
