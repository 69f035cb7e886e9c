"""DART: joint coordinates of a tree, semi-implicit Euler, loops as velocity constraints with error reduction.

A step computes u_1 = u_0 + h a, then the impulses at cut joints, then q_1 along u_1. In each step the share
``error_reduction`` of a gap is closed. dartpy has no other integrator: it does not wrap the variational one of DART's
C++ library. With ``settings`` "default" the error reduction is DART's own, 0.01. Loads are evaluated at the start of
each step.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES, KINDS
from ...harness.mechanics.joints import JointKind
from .export.engine import SPRINGS, TORSIONS, SupportedElements
from .export.protocol import Adapter


@solver("dart")
@dataclass(frozen=True)
class Dart(Adapter):
    """DART's semi-implicit Euler steps of fixed size."""

    error_reduction: float = option(
        0.8, "share of a gap that is closed a step; 0.01 is its own", at_least=0.0, at_most=1.0
    )
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    inside: ClassVar[str] = "dart"
    package: ClassVar[str] = "dartpy"
    wheel: ClassVar[str] = "dartpy"
    order: ClassVar[float] = 1.0
    takes: ClassVar[SupportedElements] = SupportedElements(
        tuple(kind for kind in KINDS if kind != JointKind.CYLINDRICAL),
        springs=False,
        torsions=False,
        loads="varying",
        lacks={
            JointKind.CYLINDRICAL: "it has no cylinder, and no body without mass to make one",
            SPRINGS: "it has none between points",
            TORSIONS: "it takes those of joints implicitly, which is another law at each step",
            **dict.fromkeys(DRIVES, "it prescribes velocities, one a step"),
        },
    )
    stretch: ClassVar[int] = 5_000  # its loop is in Python
