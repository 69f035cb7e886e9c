"""The gate's cases at reduced length, in whatever Python runs this: digests of the motions, to compare two systems.

A zero has no sign here: bits are those of numbers that compare as different.

python gate_cases.py run OUT.json [SECONDS [SOLVER ...]]: run the cases in turn until so much CPU time is used
python gate_cases.py compare HERE.json THERE.json: print the table; exit code 1 where a motion differs unexplained
"""

import dataclasses
import hashlib
import json
import platform
import sys
import time
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

STEPS = 20  # of fixed size; a rounding that differs shows in the first
SHORT = 0.05  # [s] of simulated time under error control
FIRST = (
    "spherical_pendulum[omega_z=3",
    "chain",
    "four_bar_grid",
)  # spatial and loaded; long; redundant: then the others
OTHERS = {  # solvers in whose loop other people's code computes, which only a pin of its processor holds still
    "scipy": "scipy.integrate sums stages by BLAS (numpy.dot), and LAPACK factorises A M^-1 A^T (dpbtrf)",
    "scipy_dae": "scipy_dae sums by BLAS, and LAPACK factorises Newton's matrix (dgetrf, dgbtrf)",
}
REASONS = {
    "rk45_strong_form": "scipy", "scipy_strong_form": "scipy", "ndf_index1": "scipy_dae", "radau_index1": "scipy_dae",
}  # fmt: skip


def list_cases() -> Iterator[Any]:
    """One case of each solver after another, those of ``FIRST`` before the others, shortened."""
    from mbsbench.harness.suites.suite import load_suite

    turns = defaultdict[str, int](int)
    specs = sorted(load_suite("ci").specs, key=lambda s: [not s.case.startswith(name) for name in FIRST])
    ordered = []
    for spec in specs:
        ordered.append((turns[spec.solver], len(ordered), spec))
        turns[spec.solver] += 1
    for _, _, spec in sorted(ordered, key=lambda x: x[:2]):
        t_end = SHORT if spec.control.dt is None else STEPS * spec.control.dt
        yield dataclasses.replace(spec, parameters={**spec.parameters, "t_end": t_end})


def run(out: Path, seconds: float, solvers: Collection[str]) -> None:
    """Write, for each case, its status, a digest of its motion and its last state; say on the way where it is."""
    import numpy as np

    from mbsbench.harness.catalogue import registry

    found: dict[str, Any] = {}
    cases = [spec for spec in list_cases() if not solvers or spec.solver in solvers]
    for spec in cases:
        began = time.process_time()
        if began > seconds:
            break
        problem, solver = (
            registry.make_problem(spec.problem, spec.parameters),
            registry.make_solver(spec.solver, spec.options),
        )
        reason = solver.refuses(problem, spec.control)
        row: dict[str, Any] = {"solver": spec.solver, "status": "refused", "words": str(reason or "")}
        if reason is None:
            motion = solver.solve(problem, spec.control)
            s = motion.states
            arrays = {"t": motion.t, "r": s.r, "R": s.R, "v": s.v, "Omega": s.Omega, "reaction": motion.reaction}
            bits = {k: hashlib.sha256((np.ascontiguousarray(a, dtype=float) + 0.0).tobytes()).hexdigest()[:16]
                    for k, a in arrays.items() if a is not None}  # fmt: skip
            last = np.concatenate((s.r[-1].ravel(), s.v[-1].ravel(), s.Omega[-1].ravel()))
            row |= {"status": str(motion.status), "bits": bits, "last": last.tolist(),
                    "steps": len(motion.t) - 1}  # fmt: skip
        found[spec.case] = row
        sys.stderr.write(f"{time.process_time():7.0f} s  {row['status']:9} {spec.case}\n")
        out.write_text(json.dumps({"machine": platform.machine(), "of": len(cases), "cases": found}), encoding="utf-8")


def compare(here: Path, there: Path) -> int:
    """Print a row for each case, the unexplained first; return 1 if there is one."""
    a, b = (json.loads(path.read_text(encoding="utf-8")) for path in (here, there))
    rows = [_describe(case, x, b["cases"][case]) for case, x in a["cases"].items() if case in b["cases"]]
    for row in sorted(rows, key=lambda row: row.explained):
        sys.stdout.write(f"{row.case:84} {row.words}\n")
    equal, unexplained = sum(row.words == "equal" for row in rows), sum(not row.explained for row in rows)
    sys.stdout.write(f"{b['machine']} beside {a['machine']}: {equal} of {len(rows)} cases equal, {unexplained} ")
    sys.stdout.write(f"unexplained; {a['of'] - len(rows)} of {a['of']} not run for want of time\n")
    return 1 if unexplained else 0


class Row(NamedTuple):
    """A case, whether its verdict is equality or has a known reason, and the words of the table."""

    case: str
    explained: bool
    words: str


def _describe(case: str, x: dict[str, Any], y: dict[str, Any]) -> Row:
    if "is not installed" in y["words"]:
        return Row(case, True, f"not there: {y['words'].partition(':')[0]}")
    if x["status"] != y["status"]:
        return Row(case, False, f"{x['status']}, there {y['status']} {y['words']}")
    if x["status"] == "refused":
        return Row(case, True, "refused by both")
    if x["bits"] == y["bits"]:
        return Row(case, True, "equal")
    other = " ".join(k for k in x["bits"] if x["bits"][k] != y["bits"].get(k))
    size = f"{x['steps']} and {y['steps']} steps"
    if x["steps"] == y["steps"]:
        size = f"{other}; last state {_distance(x, y):.1e}"
    why = OTHERS.get(REASONS.get(x["solver"], ""), "")
    return Row(case, bool(why), f"other bits ({size}): {why or 'NOT EXPLAINED'}")


def _distance(x: dict[str, Any], y: dict[str, Any]) -> float:
    return max(abs(p - q) for p, q in zip(x["last"], y["last"], strict=True))


if __name__ == "__main__":
    what, *given = sys.argv[1:]
    if what == "run":
        run(Path(given[0]), float(given[1]) if len(given) > 1 else float("inf"), given[2:])
    else:
        sys.exit(compare(Path(given[0]), Path(given[1])))
