"""PyBullet: Bullet's multibody in joint coordinates, semi-implicit Euler, stepped by a loop in Python.

The tree is that of ``mechanics.cut_trees``; points of cut joints are point-to-point constraints, solved by impulses.
The motors that PyBullet adds to every joint are switched off. With ``settings`` "default" the damping of 0.04 of every
body, the limit of 100 rad/s of a joint, erp and the iterations are as PyBullet ships them.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES
from ...harness.mechanics.joints import JointKind
from .export.engine import LOADS, VARYING, SupportedElements
from .export.protocol import Adapter


@solver("pybullet")
@dataclass(frozen=True)
class PyBullet(Adapter):
    """Bullet's semi-implicit Euler steps of fixed size."""

    num_solver_iterations: int = option(1000, "numSolverIterations; 50 is its own", at_least=1)
    erp: float = option(0.2, "erp of point-to-point constraints; 0.2 is its own", at_least=0.0, at_most=1.0)
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    inside: ClassVar[str] = "pybullet"
    package: ClassVar[str] = "pybullet"
    wheel: ClassVar[str] = "pybullet"
    takes: ClassVar[SupportedElements] = SupportedElements(
        (JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.FIXED),
        springs=False,
        torsions=False,
        lacks={
            **dict.fromkeys((JointKind.UNIVERSAL, JointKind.CYLINDRICAL), "its links have one axis, or a ball"),
            **dict.fromkeys((LOADS, VARYING), "forces are what its caller sets at each step"),
            "rack and pinion": "its gear is a motor of limited force",
            **dict.fromkeys(DRIVES, "its motors are of limited force"),
        },
    )
    stretch: ClassVar[int] = 2_000
    checks_random_velocities: ClassVar[bool] = True
    order: ClassVar[float] = 1.0
