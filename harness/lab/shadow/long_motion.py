"""Compute true motions far beyond the horizon of doubles, twice in multiple precision, and store them at a few times.

``python -m mbsbench.harness.lab.shadow.long_motion chain 20`` creates or continues the file of a problem. Its error is
the difference of two runs with other formulation, precision and order. A motion between stored times is integrated
anew. It is the motion of the exact numbers, which no double holds: on the chain a start rounded to doubles is a metre
away after 7 s. Runs in double precision cannot be judged by it, but shadows and clouds can.
"""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import flint
import numpy as np
from jaxtyping import Float

from ...base.files import write_text
from ...mechanics.state import States
from .rods import RECIPES, RodProblem
from .series import PlaneFlow, PreciseState

STORED = Path(__file__).parent / "long"
FIRST, SECOND = ("angles", 240), ("directors", 272)  # formulation, bits at the start
FEWEST = 96  # least number of bits of a state
AGREED = 1e-6  # [m] a motion ends where the runs differ by more
EVERY = Fraction(1, 2)  # [s]
READ = "angles", FEWEST  # formulation and bits to integrate from a stored state


@dataclass(frozen=True)
class LongMotion:
    """A stored motion: q and u of the first run as decimals, and the largest difference of both runs so far [m]."""

    problem: str
    t: tuple[Fraction, ...]
    q: tuple[tuple[str, ...], ...]
    u: tuple[tuple[str, ...], ...]
    difference: tuple[float, ...]

    @property
    def horizon(self) -> float:
        """Last stored time [s]."""
        return float(self.t[-1])

    @cached_property
    def recipe(self) -> RodProblem:
        """The bodies and the start of the problem, in exact numbers."""
        return RECIPES[self.problem]()

    def state(self, k: int, bits: int) -> PreciseState:
        """Return the state at the k-th stored time, in units of 2^-bits."""
        with flint.ctx.workprec(bits):
            q, u = ([flint.arb(x) for x in row[k]] for row in (self.q, self.u))
        return self.recipe.rods.state(q, u, to_fixed_point(self.t[k], bits), bits)

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at increasing times [s] up to the horizon, accurate to its error plus 1e-12 m.

        It is integrated from the stored state before each time. Raise ValueError for other times.
        """
        if len(t) and not (t[0] >= 0.0 and t[-1] <= self.horizon and np.all(np.diff(t) > 0.0)):
            raise ValueError(f"times must increase, from 0 to {self.horizon:g} s")
        bits = READ[1]
        parts = np.searchsorted([float(a) for a in self.t], t, "right") - 1
        found: list[PreciseState] = []
        for k in np.unique(parts):
            wanted = [to_fixed_point(Fraction(x), bits) for x in t[parts == k]]
            begin = self.state(int(k), bits)
            flow = PlaneFlow(self.recipe.rods.make_mechanism(), *READ)
            found += [begin] * (wanted[0] == begin.t)
            found += [p for p, asked in flow.march(begin, wanted[-1], wanted) if asked]
        X, V = (np.array([getattr(p, name) for p in found], dtype=float) / 2.0**bits for name in ("X", "V"))
        return self.recipe.bodies(X, V).with_times(t)

    def compute_digest(self) -> str:
        """Return the digest of the numbers that are stored."""
        return hashlib.sha256(repr((self.problem, self.t, self.q, self.u, self.difference)).encode()).hexdigest()


def load_long_motion(problem: str) -> LongMotion:
    """Load the stored motion of a problem; raise ValueError where its digest is wrong."""
    stored = json.loads((STORED / f"{problem}.json").read_text())
    motion = _parse_motion(problem, stored)
    if motion.compute_digest() != stored["sha256"]:
        raise ValueError(f"{problem}.json is damaged: its digest is not that of its states")
    return motion


def _parse_motion(problem: str, plain: dict[str, Any]) -> LongMotion:
    """Return the motion of a problem from the content of its file, ``plain``."""
    q, u = (tuple(tuple(r) for r in plain[name]) for name in ("q", "u"))
    return LongMotion(problem, tuple(map(Fraction, plain["t"])), q, u, tuple(plain["difference"]))


def to_fixed_point(a: Fraction, bits: int) -> int:
    """Return ``a`` in units of 2^-bits, rounded down."""
    return (a.numerator << bits) // a.denominator


class Integration:
    """A run, the first or the second, which ``integrate_to`` continues from the start or from the numbers ``saved``."""

    def __init__(self, recipe: RodProblem, formulation: str, bits: int, saved: dict[str, Any] | None = None) -> None:
        """Begin at the start of the problem with ``bits``, or at the state in ``saved``, as ``save`` returns it."""
        self._mechanism, self._formulation, self._most = recipe.rods.make_mechanism(), formulation, bits
        self._bits_lost_per_second = recipe.lost
        self.flow = PlaneFlow(self._mechanism, formulation, bits)
        if saved is None:
            with flint.ctx.workprec(bits + 32):
                q, u = recipe.start()
            self.now = recipe.rods.state(q, u, 0, bits)
        else:
            self.flow = PlaneFlow(self._mechanism, formulation, saved["bits"])
            self.now, self.flow.unit = PreciseState(saved["t"], saved["X"], saved["V"]), saved["unit"]

    def save(self) -> dict[str, Any]:
        """Return all that is needed to continue the run, for JSON."""
        return {"bits": self.flow.bits, "t": self.now.t, "X": self.now.X, "V": self.now.V, "unit": self.flow.unit}

    def integrate_to(self, t: Fraction) -> Iterator[PreciseState | None]:
        """Yield None after each step, so that a caller can stop, and finally the state at ``t`` [s].

        The precision is first reduced to the bits that chaos leaves meaningful at that time.
        """
        self._reduce_precision(max(FEWEST, self._most - int(self._bits_lost_per_second * t)))
        at = to_fixed_point(t, self.flow.bits)
        if self.now.t == at == 0:
            yield self.now
        for p, asked in self.flow.march(self.now, at, (at,)):
            if asked:
                reached = p
            else:
                self.now = p
                yield None if p.t < at else reached

    def _reduce_precision(self, bits: int) -> None:
        """Round the state and continue with fewer ``bits``: chaos has made the others meaningless."""
        drop, unit = self.flow.bits - bits, self.flow.unit
        X, V = ([[x >> drop for x in body] for body in part] for part in (self.now.X, self.now.V))
        self.now, self.flow = (
            PreciseState(self.now.t >> drop, X, V),
            PlaneFlow(self._mechanism, self._formulation, bits),
        )
        self.flow.unit = unit >> drop


def make_long_motion(problem: str, t_end: Fraction, stored: Path, budget: float) -> None:
    """Create or continue the file of a problem in the folder ``stored`` up to ``t_end`` [s], and print the progress.

    It ends early once ``budget`` [s] of CPU time is spent, or the runs differ by more than ``AGREED``. What is needed
    to continue is kept beside it, in ``*.work.json``.
    """
    recipe, work, path = RECIPES[problem](), stored / f"{problem}.work.json", stored / f"{problem}.json"
    begun: dict[str, Any] = {"runs": [None, None], "t": [], "q": [], "u": [], "difference": []}
    saved = json.loads(work.read_text()) if work.exists() else begun
    runs = [Integration(recipe, *of, own) for of, own in zip((FIRST, SECOND), saved["runs"], strict=True)]
    while (t := EVERY * len(saved["t"])) <= t_end:
        reached = []
        for run in runs:
            for p in run.integrate_to(t):
                if p is not None:
                    reached.append((p, run.flow.bits))
                if time.process_time() > budget:
                    return
        (first, bits), second = reached
        difference = max(measure_difference((first, bits), second), *saved["difference"], 0.0)
        if difference > AGREED:
            sys.stdout.write(f"the runs differ by {difference:.1e} m at {float(t):g} s\n")
            return
        digits = int(bits * 0.30103)
        saved["t"].append(str(t))
        saved["difference"].append(difference)
        for name, row in zip(("q", "u"), recipe.rods.find_coordinates(first, bits), strict=True):
            saved[name].append([a.mid().str(digits, radius=False) for a in row])
        saved["runs"] = [run.save() for run in runs]
        _write_motion(path, _parse_motion(problem, saved))
        write_text(work, json.dumps(saved))
        sys.stdout.write(f"{float(t):g} s, difference {difference:.1e} m, {time.process_time():.0f} s of CPU\n")
        sys.stdout.flush()


def measure_difference(a: tuple[PreciseState, int], b: tuple[PreciseState, int]) -> float:
    """Return the largest difference [m] of two states with their bits, in positions and directions times 1 m."""
    (p, bits_p), (r, bits_r) = sorted((a, b), key=lambda pair: pair[1])
    pairs = ((x, y) for X, Y in zip(p.X, r.X, strict=True) for x, y in zip(X, Y, strict=True))
    return max(abs((x << bits_r - bits_p) - y) for x, y in pairs) / 2.0**bits_r


def _write_motion(path: Path, motion: LongMotion) -> None:
    """Write the file of a motion: the command that makes it, its digest and its numbers."""
    command = f"python -m mbsbench.harness.lab.shadow.long_motion {motion.problem} {motion.horizon:g}"
    head = {"recipe": {"command": command, "first": FIRST, "second": SECOND}, "sha256": motion.compute_digest()}
    body = {"t": [str(t) for t in motion.t], "q": motion.q, "u": motion.u, "difference": motion.difference}
    write_text(path, json.dumps(head | body, indent=0) + "\n")


def main() -> None:
    """Run the command of the module: create or continue the file of a problem."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem", choices=list(RECIPES))
    parser.add_argument("t_end", type=Fraction, help="[s]")
    parser.add_argument("--stored", type=Path, default=STORED, help="folder of the files")
    parser.add_argument("--budget", type=float, default=3600.0, help="CPU time [s]")
    arguments = parser.parse_args()
    arguments.stored.mkdir(exist_ok=True)
    make_long_motion(arguments.problem, arguments.t_end, arguments.stored, arguments.budget)


if __name__ == "__main__":
    main()
