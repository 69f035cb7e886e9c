"""Entries of ODE-GC's simplified method on a kernel's arrays, from the expressions of ``rows.wrenches``."""

from typing import Any

import numpy as np

from ..compiled.kernel import Loops, list_places
from ..compiled.kernel import Step as Call
from ..generated import Program
from ..rows.kept_code import load_wrench_code


class WrenchLoops(Loops):
    """The loops of ``rows.wrenches``; x of ``rates`` and ``loads`` is the kernel's ``rhs``, w is its ``w``."""

    step: Any  # the step of ``gc_step``: plan (3,) is dt/2, B and the gauge, numbers (nb, 22) m g, m, J^-1, J

    def entries(self, direction: int, *, use_f_bar: bool) -> dict[str, Any]:
        """Return a program for each function of ``rows.wrenches``, over all groups of joints.

        ``direction`` is that of c in Eq. (31); ``use_f_bar`` includes f_bar of Eq. (30).
        """
        k, at = self._k, self.step
        calls: dict[str, list[Call]] = {name: [] for name in ("begin", "impulses", "rates", "loads")}
        for group in self._groups:
            code, size0, size = load_wrench_code(*group.key, direction, use_f_bar=use_f_bar)
            own, count, m = group.rows, group.members, int(group.members[0])
            kept0, kept = np.zeros((m, size0)), np.zeros((m, size))
            pose, f_bar = ((k.r, 3), (k.R, 9), (at.u, 6)), [at.f_bar[own]] if use_f_bar else []
            more = (*pose, (at.numbers, 22))
            poses, to = list(list_places(group, *more if use_f_bar else pose)), list(list_places(group, (k.w, 6)))
            whole, nu = [count, k.t, at.plan, group.numbers], (at.nu[own], at.nu_start[own])
            given = {
                "begin": [*whole, *list_places(group, *more), kept0, at.slip[own], *f_bar, *to],
                "impulses": [*whole, kept0, *nu, *poses, kept, *f_bar, *to],
                "rates": [count, kept, *list_places(group, (at.u, 6)), k.rhs[own]],
                "loads": [count, kept, k.rhs[own], *list_places(group, (at.load, 6))],
            }
            for name, arrays in given.items():
                calls[name].append((code.address(name), arrays))
            self._keeps.append(code)
        return {name: Program(some, (self._keeps, k)) for name, some in calls.items()}
