"""Judgement files made by hand, in the format that pages are promised, hostile texts and holes among them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..conftest import HOSTILE


def claims(runs: Sequence[str]) -> list[dict[str, Any]]:
    """One of each verdict, one with a map of two charts and two starts, a check of the variant, one that attacks."""
    at = [
        {"run": runs[k % len(runs)], "case": f"case {k}", "tolerance": tolerance, "gain": gain, "form": "fi",
         "chart": chart, "lambda_in_error_test": True, "consistent_start": start, "frame": "aligned",
         "holds": None if k % 7 == 6 else (tolerance < 1e-4 or gain == 0.0), "measured": 0.01 * k,
         "status": "step_underflow" if k % 5 == 4 else "success", "printed": k == 0}
        for k, (chart, start, tolerance, gain) in enumerate(
            (c, s, t, g) for c in ("euler313", "quaternion") for s in (True, False)
            for t in (1e-3, 1e-5, 1e-7) for g in (0.0, 5.0, 20.0, "1/h"))
    ]  # fmt: skip

    def claim(name: str, verdict: str, **more: Any) -> dict[str, Any]:
        return {"id": name, "section": "5.2", "figure": "6, 7", "quote": "failed to run further at about 32 s",
                "claim": f"A claim that is {verdict.lower()}", "verdict": verdict, "measured": 0.02, "unit": "m",
                "band": [0.0, 0.05], "because": "it was measured", "settings": {"rtol": 1e-3, "max_step_s": 0.01},
                "runs": list(runs[:2]), "map": [], "missing": ""} | more  # fmt: skip

    return [
        claim("first-claim", "SUPPORTED"),
        claim("second-claim", "REFUTED", measured=3.0, band=[None, 0.05], section="5.4"),
        claim("third-claim", "CONDITIONAL", map=at, measured_range=[0.001, 0.4],
              factors={"gain": {"gain 0": [6, 6], "gain 5": [2, 6]}, HOSTILE: {HOSTILE: [1, 2]}, "odd": 3},
              tests=[{"metric": "largest [series x]", "band": "at most 0.05 m", "measured_words": "0.02 m"},
                     {"metric": HOSTILE, "band": HOSTILE, "measured_words": HOSTILE}]),
        claim("fourth-claim", "UNTESTABLE", measured=None, band=None, missing=["the commercial code", "its data"],
              runs=[], settings=None, section="5.3"),
        claim("posed-claim", "SUPPORTED", kind="presentation"),
        claim(HOSTILE, "SUPPORTED", section=HOSTILE, figure=HOSTILE, quote=HOSTILE, claim=HOSTILE, because=HOSTILE,
              unit=HOSTILE, settings={HOSTILE: HOSTILE}, runs=[HOSTILE, "unknown"],
              map=[{"form": HOSTILE, "case": HOSTILE, "run": HOSTILE}], missing=HOSTILE),
    ]  # fmt: skip


def certificates(runs: Sequence[str]) -> list[dict[str, Any]]:
    """Second order with a coarse step too many, first order that is not, the floor, nothing at all, an attack."""
    dts = [0.04, 0.02, 0.01, 0.005, 0.0025]

    def row(quantity: str, errors: list[float], used: list[bool], order: float | None, **more: Any) -> dict[str, Any]:
        return {"problem": "pendulum", "variant": "pendulum", "solver": "alpha", "case": "pendulum alpha", "unit": "m",
                "quantity": quantity, "symbol": "|q|", "declared": 2.0, "order": order,
                "low": None if order is None else order - 0.02, "high": None if order is None else order + 0.02,
                "dt": dts, "error": errors, "used": used, "floor": 1e-12, "verdict": "holds", "words": "fits",
                "t_end_s": 2.0, "runs": list(runs[:2])} | more  # fmt: skip

    square = [d**2 for d in dts]
    return [
        row("q", [10.0 * square[0], *square[1:]], [False, True, True, True, True], 2.0),
        row("v", [0.1 * d for d in dts], [True] * 5, 1.0, verdict="below declared", words="first order", solver="beta"),
        row("energy", [1e-13] * 5, [False] * 5, None, verdict="exact", words="at the floor", unit="J"),
        row(HOSTILE, [], [], None, variant=HOSTILE, solver=HOSTILE, case=HOSTILE, symbol=HOSTILE, unit=HOSTILE,
            words=HOSTILE, verdict=HOSTILE, runs=[HOSTILE]),
    ]  # fmt: skip


def drift(runs: Sequence[str]) -> list[dict[str, Any]]:
    """A swing, a line, an attack with nothing in it."""

    def row(solver: str, verdict: str, **more: Any) -> dict[str, Any]:
        return {"problem": "pendulum", "variant": "pendulum", "solver": solver, "case": f"pendulum {solver}",
                "run": runs[0], "periods": 400.0, "span_s": 600.0, "oscillation_J": 1e-3, "trend_W": 1e-9,
                "trend_low_W": -1e-9, "trend_high_W": 3e-9, "walk_J_per_sqrt_s": 1e-8, "walk_low": 0.0,
                "walk_high": 2e-8, "verdict": verdict, "words": "as said"} | more  # fmt: skip

    return [
        row("alpha", "bounded"),
        row("beta", "drifts", trend_W=-1e-5, trend_low_W=-1.1e-5, trend_high_W=-0.9e-5),
        {"variant": HOSTILE, "solver": HOSTILE, "verdict": HOSTILE, "words": HOSTILE, "oscillation_J": None},
    ]


def metamorphic(runs: Sequence[str]) -> list[dict[str, Any]]:
    """Every verdict, two problems in one box."""

    def row(solver: str, check: str, verdict: str, problem: str = "pendulum") -> dict[str, Any]:
        return {"solver": solver, "check": check, "problem": problem, "variant": problem, "deviation": 1e-9,
                "bound": 1e-6, "unit": "m", "verdict": verdict, "words": f"{check} {verdict}",
                "runs": list(runs[:1])}  # fmt: skip

    return [
        row("alpha", "time reversal", "holds"), row("alpha", "time reversal", "broken", "chain"),
        row("alpha", "yaw", "holds"), row("beta", "time reversal", "failed"), row("beta", "yaw", "refused"),
        row("gamma", "yaw", "not applicable"), row(HOSTILE, HOSTILE, HOSTILE, HOSTILE),
    ]  # fmt: skip


def work(runs: Sequence[str]) -> dict[str, Any]:
    """Three points of one solver, the best one told, an attack; a profile of two solvers."""
    points = [
        {"problem": "pendulum", "variant": "pendulum", "solver": "alpha", "case": f"pendulum alpha {k}",
         "run": runs[k % len(runs)], "label": "recommended", "best": k == 2, "error": 10.0**-k,
         "error_kind": "position error", "unit": "m", "energy_drift_J": 10.0**-k, "phi_max": 0.0, "cpu_s": 0.1 * 2**k,
         "steps": 100 * 2**k, "evaluations": 300 * 2**k, "operations": 310.0 * 2**k,
         "factorisations": None, "reference_own_error": 1e-9}
        for k in range(3)
    ]  # fmt: skip
    points.append(dict.fromkeys(("problem", "variant", "solver", "case", "label", "error_kind", "unit", "run"), HOSTILE)
                  | {"error": 1.0, "evaluations": 5.0})  # fmt: skip
    profile = [
        {"solver": "alpha", "work": "evaluations", "total": 4, "target_work": [10.0, 100.0, 1000.0]},
        {"solver": "beta", "work": "evaluations", "total": 4, "target_work": [20.0]},
        {"solver": HOSTILE, "work": "evaluations", "total": 4, "target_work": []},
    ]
    return {"points": points, "profile": profile}


def wrong(runs: Sequence[str]) -> list[dict[str, Any]]:
    """One known run, one unknown with an attack."""
    return [
        {"case": "pendulum beta", "run": runs[0], "solver": "beta", "problem": "pendulum", "because": ["too hot"]},
        {"case": HOSTILE, "run": HOSTILE, "solver": HOSTILE, "problem": HOSTILE, "because": [HOSTILE]},
    ]  # fmt: skip


def judge(folder: Path, runs: Sequence[str]) -> None:
    """All files of ``<run>/judgement/``."""
    where = folder / "judgement"
    where.mkdir(parents=True, exist_ok=True)
    files = {"claims": claims, "certificates": certificates, "drift": drift, "metamorphic": metamorphic, "work": work,
             "wrong": wrong}  # fmt: skip
    for name, make in files.items():
        (where / f"{name}.json").write_text(json.dumps(make(runs)), encoding="utf-8")
