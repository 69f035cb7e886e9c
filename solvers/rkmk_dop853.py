"""Runge-Kutta-Munthe-Kaas with DOP853, the pair 8(5,3) of Hairer, Norsett and Wanner (1993), on index 1, projected.

Unknowns are positions and rotation vectors of the step, R = R0 exp(theta), with theta' = dexp^-1(theta) Omega
(Munthe-Kaas 1999, Appl. Numer. Math. 29), and velocities; accelerations follow from S lam = -gamma - A M^-1 f,
S = A M^-1 A^T (Eq. 92, M^-1 substituted). After every accepted step poses are projected onto phi = 0 and velocities
onto A v = 0 along M^-1 A^T. Redundant rows get a multiplier of zero; nothing else
stabilises or damps the motion.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from ..harness.base.tableaux import DOPRI853, Tableau
from ..harness.catalogue.registry import solver
from .formulations.compiled.public import accelerations
from .formulations.methods.rkmk import ExplicitPair


@solver("rkmk_dop853")
@dataclass(frozen=True)
class RkmkDop853(ExplicitPair):
    """DOP853 on the rotation group, index 1 with projection, error control."""

    tableau: ClassVar[Tableau] = DOPRI853
    pair: ClassVar[str] = "8(5,3)"
    accelerations: ClassVar[Any] = staticmethod(accelerations)  # offered to experiments
