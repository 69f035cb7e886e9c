"""Write the table in docs/judging.md: solvers and engines on the chain over 20 s, by error, shadow and ensemble.

python docs/list_shadows.py measure SOLVER ...    # runs them, into results/published/chaos.json
python docs/list_shadows.py cloud N SOLVER ...    # scores their ensembles of N starts, into the same file
python docs/list_shadows.py                       # writes the page from it
"""

import mbsbench  # noqa: F401  before NumPy: it pins the arithmetic

# isort: split
import fcntl
import json
import math
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm, spearmanr

from mbsbench.harness.base.clock import cpu_seconds
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.codes import digest_run_code
from mbsbench.harness.catalogue.suites.spec import make_spec, make_step_control
from mbsbench.harness.lab.ensemble.clouds import ConfiguredSolver, make_ensemble, run_cloud
from mbsbench.harness.lab.ensemble.sampling import interpolate_state
from mbsbench.harness.lab.ensemble.verdict import ALL_C, compare_clouds
from mbsbench.harness.lab.shadow.long_motion import load_long_motion
from mbsbench.harness.lab.shadow.modified_energy import find_modified_energy
from mbsbench.harness.lab.shadow.shadow import find_shadow
from mbsbench.harness.mechanics.types import Problem, StepControl, Trajectory
from mbsbench.harness.results.environment import read_commit
from mbsbench.harness.results.words import describe_ending, list_reasons
from mbsbench.harness.run.run_file import read_run
from mbsbench.harness.run.solve_file import solve_to_file

HERE = Path(__file__).resolve().parent
PAGE, DATA = HERE / "judging.md", HERE.parent / "results" / "published" / "chaos.json"
RUNS = HERE.parent / "results" / "local" / "chaos"  # kept, so that a motion is solved once by the same code
LOCK = RUNS / "lock"
TABLE = re.compile(r"(?<=<!-- made from chaos\.json by list_shadows\.py -->\n).*(?=<!-- end -->)", re.DOTALL)
LIMIT = 100.0  # [s] of CPU for a run
EARLY, LATE = 5.0, 20.0  # [s] times of errors
SPREAD, SEED, SCORED = 1e-3, 1, (2.0, 20.0)
TRUTH = "rkmk_dop853"
SURE = 0.01  # largest p of a bias that is printed in bold
GOAL = 60.0  # [s] of CPU for a shadow
SOUND = ("success", "inaccurate")


def measure_solver(problem: Problem, solver: str) -> dict[str, Any]:
    """Return the row of a solver: its run, which is solved unless this code's is kept, its errors and its shadow."""
    spec = make_spec(problem, solver)
    code = digest_run_code(problem.name, solver)
    path = RUNS / f"{solver}-{code}.npz"
    if not path.exists():
        solve_to_file(spec, path, LIMIT)
    r, trajectory = read_run(path)
    words = "; ".join(w for w in dict.fromkeys([describe_ending(r), *list_reasons(r)]) if w)
    setting = next(f"{k}={v:g}" for k in ("dt", "rtol") if (v := getattr(spec.control, k)) is not None)
    row = {
        "solver": solver,
        "setting": setting,
        "status": r.status,
        "why": words,
        "t_reached_s": r.t_reached_s,
        "cpu_s": r.cpu_min_s,
        "energy_drift_J": r.energy_drift_max_J,
        "accurate_until_s": r.accurate_until_s,
        "accurate_until_1pct_s": r.accurate_until_1pct_s,
        "code": code,
        "commit": read_commit(),
    }
    old = read_data().get("runs", {}).get(solver, {})
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()} | {
        "error_m": measure_errors(problem, trajectory),
        "modified_energy": measure_modified_energy(problem, trajectory),
        "shadow": old["shadow"] if old.get("code") == code else describe_shadow(problem, trajectory),
    }


def measure_modified_energy(problem: Problem, trajectory: Trajectory) -> float | None:
    """Return the range of the modified energy relative to its scale; None where it is not defined."""
    try:
        found = find_modified_energy(problem, trajectory)
    except ValueError:
        return None
    return found.energy_range / found.scale


def measure_errors(problem: Problem, trajectory: Trajectory) -> dict[str, float]:
    """Return the largest error of any centre of mass [m] at ``EARLY`` and ``LATE``, by time, where it is known."""
    out = {}
    reference, far = problem.reference(), load_long_motion(problem.name)
    for t, true in ((EARLY, reference), (LATE, far)):
        if true is not None and true.horizon >= t <= trajectory.t[-1] * (1.0 + 1e-9):
            C = true.states(np.array([t])).r[0]
            out[f"{t:g}"] = float(np.max(np.linalg.norm(interpolate_state(trajectory.states, t).r - C, axis=1)))
    return out


def describe_shadow(problem: Problem, trajectory: Trajectory) -> dict[str, Any]:
    """Return numbers on the shadow of a motion, or the reason why none can be computed."""
    began = cpu_seconds()
    try:
        s = find_shadow(problem, trajectory)
    except ValueError as error:
        return {"none": str(error)}
    C = s.distance
    found = {"until_s": s.until, "glitch_s": s.glitch, "gap_m": s.gap, "cpu_s": cpu_seconds() - began}
    if s.until > 0.0:
        found |= {
            "largest_m": float(np.max(C)),
            "rms_m": float(np.sqrt(np.mean(C**2))),
            "start_m": float(np.max(C[0])),
            "start_m_s": float(np.max(np.linalg.norm(s.given.v[0] - s.true.v[0], axis=1))),
            "energy_shift_J": s.energy_shift,
        }
    return replace_nan(found)


def replace_nan(numbers: dict[str, Any]) -> dict[str, Any]:
    """Replace numbers that are not finite by None, since JSON cannot express them."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in numbers.items()}


def score_ensembles(problem: Problem, solvers: list[str], starts: int) -> dict[str, Any]:
    """Score the ensembles of solvers and store each; return by solver the number of starts and two scores at each time.

    The scores are the energy score of all C and the CRPS of the energy, each with its excess, p, bias and spread. All
    clouds have the same starts: part of their excess is due to this draw, as ``TRUTH`` shows.
    """
    e = make_ensemble(problem, SPREAD, SEED, SCORED)
    true = registry.make_solver(TRUTH, {"code": "mechanism"})
    code = ConfiguredSolver(TRUTH, "", true, StepControl(rtol=1e-10))
    same, other = (run_cloud(e, code, range(k * starts, (k + 1) * starts), 1) for k in range(2))
    out = {}
    for solver in solvers:
        control = make_step_control(
            solver, registry.find_entry("solver", solver, registry.solvers()).control, problem, {}
        )
        cloud = run_cloud(e, ConfiguredSolver(solver, "", registry.make_solver(solver), control), range(starts), 1)
        rows = [c for c in compare_clouds(e, cloud, same, other) if c.quantity in (ALL_C, "energy")]
        out[solver] = {"starts": starts} | {
            f"{c.quantity} {c.t_s:g}": replace_nan(
                {
                    "excess": c.excess,
                    "p": c.p_score,
                    "bias": c.bias,
                    "spread": c.spread,
                    "error": c.error,
                    "missing": c.missing,
                }
            )
            for c in rows
        }
        add_rows("ensembles", out)
    return out


def read_data() -> dict[str, dict[str, Any]]:
    """Return the published data; empty without the file."""
    return json.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}


def add_rows(part: str, rows: dict[str, Any]) -> None:
    """Add ``rows`` to a part of the data in its file, under a lock, since other processes add to it as well."""
    with LOCK.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        plain = read_data()
        plain[part] = dict(sorted((plain.get(part, {}) | rows).items()))
        DATA.write_text(json.dumps(plain, indent=1, sort_keys=True, allow_nan=False) + "\n", encoding="utf-8")


def format_table() -> str:
    """Return the table with a row per solver: the longest shadows first, then the nearest."""
    data = read_data()
    heads = [
        "solver",
        "status",
        "energy drift [J]",
        "accurate until [s]",
        "error at 5 s [m]",
        "at 20 s",
        "shadow until [s]",
        "rms [mm]",
        "largest",
        "at the start",
        "gap [m]",
        "its CPU time [s]",
        "modified energy",
    ]
    clouds = data.get("ensembles", {})
    heads += ["starts", "excess of all C at 2 s [m]", "bias of energy at 20 s [J]"] if clouds else []
    rows = [f"| {' | '.join(heads)} |", "|---|---|" + "--:|" * (len(heads) - 2)]
    for r in sorted(data["runs"].values(), key=make_rank_key):
        s, cloud = r["shadow"], clouds.get(r["solver"], {})
        cells = [
            f"`{r['solver']}` {r['setting']}",
            r["status"],
            format_number(r["energy_drift_J"]),
            format_number(r["accurate_until_s"]),
            *(format_number(r["error_m"].get(f"{t:g}")) for t in (EARLY, LATE)),
            format_number(s.get("until_s")),
            *(format_number(s.get(k), 1e3) for k in ("rms_m", "largest_m", "start_m")),
            format_number(s.get("gap_m") if s.get("until_s") else None, digits=1),
            format_number(s.get("cpu_s")),
            format_number(r["modified_energy"], digits=1),
            format_starts(cloud),
            format_excess(cloud, clouds),
            format_bias(cloud, clouds),
        ]
        rows.append(f"| {' | '.join(cells[: len(heads)])} |")
    return "\n".join(rows) + "\n"


def format_page() -> str:
    """Return the summary of the table in words, and the table."""
    data = read_data()
    rows = list(data["runs"].values())
    shadows = [r["shadow"] for r in rows if (r["shadow"].get("until_s") or 0.0) >= LATE]
    none = [f"`{r['solver']}`" for r in rows if (r["shadow"].get("until_s") or 0.0) < LATE and r["status"] in SOUND]
    late = [r["error_m"][f"{LATE:g}"] for r in rows if r["shadow"] in shadows]
    rms = sorted(1e3 * s["rms_m"] for s in shadows)
    lesson = (
        f"The chain over {LATE:g} s at the settings that `solve` takes by default. Of {len(rows)} codes measured "
        f"{len(shadows)} have a true motion nearby over the whole time. Their errors at {LATE:g} s, {min(late):.2g} to "
        f"{max(late):.2g} m, hardly distinguish them; the rms distances of their shadows do: {rms[0]:.1g} to "
        f"{rms[-1]:.2g} mm. "
    )
    near = sorted((r for r in rows if r["shadow"] in shadows), key=make_rank_key)
    still = min(near, key=lambda r: r["energy_drift_J"])
    order = spearmanr([r["energy_drift_J"] for r in near], [r["shadow"]["rms_m"] for r in near]).statistic
    lesson += (
        f"The drift of energy ranks them much alike (Spearman {order:.2g}), but for `{still['solver']}`, which keeps "
        f"it best, to {still['energy_drift_J']:.1e} J: its shadow is number {near.index(still) + 1} of {len(near)}. "
    )
    slow = [f"`{r['solver']}`" for r in sorted(rows, key=make_rank_key) if r["shadow"].get("cpu_s", 0.0) > GOAL]
    lesson += f"Shadows that took more than {GOAL:g} s of CPU: {', '.join(slow) or 'none'}. "
    if none:
        lesson += f"Lawful to the end, yet without a shadow found that far: {', '.join(none)}. "
    if data.get("ensembles"):
        lesson += (
            f"Ensembles: from the same starts, less the excess of `{TRUTH}` from these. In bold: a bias that chance "
            f"alone gives in less than one of {1 / SURE:.0f} cases; a cloud that blew up is too wide to show one."
        )
    return f"{textwrap.fill(lesson, 98)}\n\n{format_table()}"


def make_rank_key(row: dict[str, Any]) -> tuple[float, float]:
    """Return the sort key of a row: the longest shadow first, then the nearest."""
    s = row["shadow"]
    return -(s.get("until_s") or 0.0), s.get("rms_m") or math.inf


def format_number(value: float | None, scale: float = 1.0, digits: int = 2) -> str:
    """Format a number, multiplied by ``scale``; a dash for None."""
    return "–" if value is None else f"{scale * value:.{digits}g}"


def format_starts(cloud: dict[str, Any]) -> str:
    """Format the number of starts of an ensemble, and how many of them did not reach the end."""
    missing = max((score["missing"] for score in cloud.values() if isinstance(score, dict)), default=0)
    return format_number(cloud.get("starts"), digits=4) + (f", {missing} missing" if missing else "")


def format_excess(cloud: dict[str, Any], clouds: dict[str, Any]) -> str:
    """Format the excess of all C at 2 s, less that of ``TRUTH`` from the same starts; a dash if one is missing."""
    score, own = (of.get(f"{ALL_C} 2", {}) for of in (cloud, clouds.get(TRUTH, {})))
    if score.get("excess") is None or own.get("excess") is None or cloud["starts"] != clouds[TRUTH]["starts"]:
        return "–"
    return format_number(score["excess"] - own["excess"])


def format_bias(cloud: dict[str, Any], clouds: dict[str, Any]) -> str:
    """Format the bias of the energy at 20 s, in bold if it is significant; a dash if it is missing.

    Its standard error is that of the difference of two means, the second of ``TRUTH``.
    """
    score, true = (of.get("energy 20", {}) for of in (cloud, clouds.get(TRUTH, {})))
    if score.get("bias") is None or true.get("spread") is None:
        return "–"
    error = math.hypot(score["spread"], true["spread"]) / math.sqrt(cloud["starts"] - score["missing"])
    sure = abs(score["bias"]) > norm.isf(0.5 * SURE) * error
    return f"**{score['bias']:.2g}**" if sure else f"{score['bias']:.2g}"


def main() -> None:
    """Run the command that the arguments name: measure, cloud, or without any write the page."""
    problem = registry.make_problem("chain", {})
    RUNS.mkdir(parents=True, exist_ok=True)
    if sys.argv[1:2] == ["measure"]:
        for solver in sys.argv[2:]:
            row = measure_solver(problem, solver)
            add_rows("runs", {solver: row})
    elif sys.argv[1:2] == ["cloud"]:
        score_ensembles(problem, sys.argv[3:], int(sys.argv[2]))
    else:
        PAGE.write_text(TABLE.sub(lambda _: format_page(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
