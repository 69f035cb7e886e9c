"""The table of changes to a bundle: field x change x what the checker must say, and the fields that no bundle decides.

Every column of a record, every key of a problem, of its numbers, of a run and of the head has its row: a test fails for
a field without one. A column that no bundle decides says why where it is declared (``unchecked``).
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbsbench.harness.mechanics.types import EndCause, Status
from mbsbench.harness.results.records import DECLARED

Change = Callable[[Any], Any]

BASES: dict[str, Callable[[dict], bool]] = {  # runs of the suite, each a bundle by itself
    "top": lambda r: r["problem"] == "heavy_top" and r["status"] == "success",
    "wrong": lambda r: r["problem"] == "heavy_top" and r["status"] == "wrong",
    "planar": lambda r: r["problem"] == "spherical_pendulum" and "literal" not in r["problem_parameters"],
    "literal": lambda r: r["problem"] == "spherical_pendulum" and "literal" in r["problem_parameters"],
    "linkage": lambda r: r["problem"] == "damped_linkage",
    "crank": lambda r: r["problem"] == "driven_slider_crank",
    "pump": lambda r: r["problem"] == "pumped_pendulum",
    "refused": lambda r: r["solver"] == "refuses",
    "crashed": lambda r: r["solver"] == "raises",
    "failed": lambda r: r["solver"] == "gives_up",
}


def raise_number(x: Any) -> float:
    return 1.1 * float(x) + 1e-3


def lower_number(x: Any) -> float:
    return 0.9 * float(x) - 1e-3


def to(value: Any) -> Change:
    """A change to a value."""
    return lambda old: value


MOVED = {"raised": raise_number, "lowered": lower_number}
NUMBER = {**MOVED, "nan": to("nan")}
COUNT = {"raised": lambda n: n + 1, "lowered": lambda n: n - 1}
NEGATIVE = {"below zero": to(-1.0)}
SCALED = {"raised": lambda a: (1.1 * np.array(a)).tolist(), "shifted": lambda a: (np.array(a) + 0.1).tolist()}
TURNED = {"turned": lambda a: np.roll(np.array(a), 1, axis=-1).tolist()}


@dataclass(frozen=True)
class Row:
    """Changes of a field that are found, in which run, and what is said; why other changes of it are not."""

    changes: dict[str, Change]
    says: str | None = None  # the name of the field; empty: whatever comes first
    base: str = "top"
    undecided: str = ""
    weakens: bool = False  # counted and printed, no disagreement


def undecided(why: str) -> Row:
    """A field that no bundle decides."""
    return Row({}, undecided=why)


WORDS, ASKED = "words of who ran it", "asked of the solver: nothing in a motion shows it"
OWN_WORD, MACHINE = "the solver's own word", "of the machine that ran it: bounds alone are known"
ADDRESS = "an address, from which nothing is computed"


def cost(**more: Change) -> Row:
    """A cost: it is not below zero, and in order with others."""
    return Row({**NEGATIVE, **more}, undecided=MACHINE)


def drifts(key: str, change: Change) -> Change:
    """Change a number of the first entry of a column of JSON."""

    def edit(text: str) -> str:
        plain = json.loads(text)
        first = next(iter(plain.values()))
        first[key] = change(first[key])
        return json.dumps(plain)

    return edit


def reasons(key: str) -> Change:
    """Change a number of the first reason."""
    return lambda text: json.dumps([r | {key: 2.0 * float(r[key])} for r in json.loads(text)])


RECORDS: dict[str, Row] = {
    **{name: undecided(d.unchecked) for name, d in DECLARED.items() if d.unchecked},  # as their declarations say
    "run_id": Row({"another": to("0" * 16)}, "without a record"),
    "settings_id": undecided(ADDRESS),
    "case": undecided(WORDS),
    "label": undecided(WORDS),
    "suite": undecided("a folder may hold runs of several suites"),
    "paper_label": undecided(OWN_WORD),
    "problem": Row({"another": to("chain")}),
    "section": Row({"another": to("Sect. 9")}),
    "problem_parameters": Row({"another": to('{"t_end": 0.2}'), "none": to("{}")}),
    "problem_fingerprint": undecided("a combination of numbers that are here one by one"),
    "solver": undecided("who solved it: a motion does not show it"),
    "declared_order": undecided(OWN_WORD),
    "solver_options": undecided(ASKED),
    "control": Row({"the other": to("rtol")}),
    "dt_s": Row({"half": lambda x: 0.5 * x, "double": lambda x: 2.0 * x, "nan": to("nan")}, undecided="near the step"),
    "rtol": Row({"both": to(1e-6)}, "control", undecided=ASKED),
    "max_step_s": undecided(ASKED),
    "max_steps": undecided(ASKED),
    "t_end_s": Row(NUMBER),
    "cpu_limit_s": cost(),
    "wall_limit_s": cost(),
    "memory_limit_MB": cost(),
    "status": Row({s: to(str(s)) for s in Status if s != "success"}),
    "claimed": Row({"nothing": to(""), "another": to("stalled")}, "status"),
    "ended_by": Row({str(by): to(str(by)) for by in EndCause if by not in ("solver", "cpu_limit", "suspended")}),
    "ended_limit_s": undecided(MACHINE),
    "message": undecided(WORDS),
    "missing_package": Row({"one": to("numpy")}),
    "wrong_because": Row(
        {"none": to("[]"), "another law": lambda x: x.replace("constraint", "energy")},
        base="wrong",
        undecided="times of reasons, and values of mechanisms",
    ),
    "notes": undecided(OWN_WORD),
    "events": Row({"below zero": to(-1)}, undecided=OWN_WORD),
    "t_reached_s": Row(NUMBER),
    "exit_code": Row({"70": to(70)}, "signal and exit_code"),
    "signal": Row({"9": to(9)}, "signal and exit_code"),
    **{
        name: Row(NUMBER)
        for name in (
            "energy_start_J",
            "energy_scale_J",
            "energy_drift_max_J",
            "energy_drift_end_J",
            "energy_trend_W",
            "energy_mean_first_quarter_J",
            "energy_mean_last_quarter_J",
            "length_scale_m",
            "speed_scale_m_per_s",
            "phi_max",
            "phi_end",
            "phi_limit_m",
            "phi_dot_max",
            "phi_dot_limit_m_per_s",
            "phi_dot_end",
            "gap_share_max",
            "gap_rate_share_max",
            "eq81_max_sqrtJ",
            "eq81_end_sqrtJ",
            "orthogonality_max",
            "kinematic_defect",
            "reference_own_error_m",
            "compared_to_s",
            "accurate_until_s",
            "accurate_until_1pct_s",
            "accurate_until_0p1pct_s",
            "motion_error_max_m",
            "position_error_max_m",
            "position_error_end_m",
            "orientation_error_max_rad",
            "orientation_error_end_rad",
            "velocity_error_max_m_per_s",
            "angular_velocity_error_max_rad_per_s",
            "reaction_error_max_N",
            "reaction_size_N",
            "moment_error_max_Nm",
            "moment_size_Nm",
            "judged_to_s",
            "reference_own_error_judged_m",
            "motion_error_judged_m",
            "rate_error_judged_m_per_s",
            "motion_between_max_m",
            "position_error_judged_m",
            "orientation_error_judged_rad",
            "step_min_s",
            "step_median_s",
            "step_max_s",
            "step_ratio",
        )
    },
    "out_of_plane_max_m": Row(NUMBER, base="planar"),
    "reference_horizon_s": Row(NUMBER, base="linkage"),
    "reference": Row({"another": to("closed form"), "none": to("")}),
    "observable_errors": Row(
        {f"{key} {how}": drifts(key, change) for key in ("max", "end") for how, change in MOVED.items()}, "observable"
    ),
    "invariant_drifts": Row(
        {f"{key} {how}": drifts(key, change) for key in ("max", "end", "start") for how, change in MOVED.items()}
        | {"none": to("{}")},
        "invariant",
    ),
    "steps": Row(COUNT),
    "repeats": Row({"none": to(0), "below zero": to(-1)}, undecided=MACHINE),
    "cpu_min_s": cost(**{"above the median": to(1e6)}),
    "cpu_q1_s": cost(**{"above the median": to(1e6)}),
    "cpu_median_s": cost(**{"above all": to(1e6), "below all": to(1e-12)}),
    "cpu_q3_s": cost(**{"below the median": to(1e-12)}),
    "cpu_max_s": cost(**{"above the process": to(1e6)}),
    "cpu_process_s": Row({**NEGATIVE, "below its solve": to(-0.2)}, undecided=MACHINE),
    "code_s": cost(**{"above the process": to(1e6)}),
    **{
        name: cost()
        for name in ("cpu_call_s", "setup_s", "cpu_import_s", "cpu_refuses_s", "wall_s", "measure_s", "peak_memory_MB")
    },
    "series": undecided("a file of the folder"),
    "series_sha256": undecided("a file of the folder"),
    "series_rows": Row({"more than steps": to(10**6)}, undecided="fewer where the file is thinned"),
    "stderr": undecided("a file of the folder"),
    "code": Row({"another": to("0" * 16)}),
    "measured_by": undecided(ADDRESS),
    "commit": undecided(ADDRESS),
    "environment": Row({"another": to("0" * 12)}, "without the packages and the machine", weakens=True),
    "finished": undecided("a clock's word"),
    "schema": Row({"2": to(2), "4": to(4)}),
}
SAID_AS = dict.fromkeys(("cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s"), "order of CPU times")
SAID_AS["cpu_max_s"] = "cpu_process_s"

PROBLEMS: dict[str, Row] = {
    "problem": Row({"another": to("chain")}),
    "parameters": Row({"another": to({"t_end": 0.2})}, "problem_parameters"),
    "section": Row({"another": to("Sect. 9")}),
    "t_end_s": Row({"raised": raise_number, "lowered": lower_number}),
    "literal_start": Row({"on": to(True)}),
    "body_names": Row({"one more": lambda a: [*a, "x"]}, undecided=WORDS),
    "joint_names": Row({"one more": lambda a: [*a, "x"]}, undecided=WORDS),
    "joint_kinds": Row({"one more": lambda a: [*a, "spherical"], "another": lambda a: ["spring", *a[1:]]}, ""),
    "not_serialised": Row({"one": to(["user force 0"])}),
    "invariants": Row(
        {
            "one less": lambda a: a[1:],
            "a unit": lambda a: [a[0] | {"unit": "J"}, *a[1:]],
            "a direction": lambda a: [a[0] | {"along": [0.6, 0.0, 0.8]}, *a[1:]],
            "a quantity": lambda a: [a[0] | {"quantity": "momentum"}, *a[1:]],
        },
        "invariant",
    ),
    "reference": Row(
        {
            "its kind": lambda a: a | {"kind": "none"},
            "its route": lambda a: a | {"route": "luck"},
            "its horizon": lambda a: a | {"horizon_s": 0.05},
        },
        "reference",
    ),
    "numbers": undecided("each has its own row"),
}
EMPTIED = Row({"none of several": to([])}, "with invariants that their problem does not describe", weakens=True)

NUMBERS: dict[str, Row] = {
    **{
        name: Row(SCALED, "")
        for name in ("mass", "inertia", "gravity", "start_r", "start_R", "start_Omega", "joint_s_i")
    },
    **{name: Row({"shifted": SCALED["shifted"]}, "") for name in ("start_v", "joint_s_j")},
    "gyration": Row({"lowered": lambda a: (0.5 * np.array(a)).tolist()}, undecided="larger of thin rods"),
    "frame": Row(SCALED, undecided="another rotation: it only turns the home axes"),
    "planar_normal": Row(SCALED, base="planar"),
    "joint_i": Row({"another": lambda a: [*a[1:], a[0]]}, "", "linkage"),
    "joint_j": Row({"another": lambda a: [*a[1:], a[0]]}, "", "linkage"),
    "joint_u": Row(TURNED, "", "crank"),
    "joint_w": Row(TURNED, "", "crank"),
    "joint_n": Row(TURNED, "", "crank"),
    "joint_length": Row({"raised": SCALED["raised"]}, "", "linkage"),
    "joint_motion": Row({"raised": SCALED["raised"]}, "", "pump"),
    "joint_k": Row({"raised": SCALED["raised"]}, "", "linkage"),
    "joint_c": Row({"tenfold": lambda a: (10.0 * np.array(a)).tolist()}, "", "linkage"),
    "joint_points": Row({"none": lambda a: [0] * len(a)}, ""),
    "joint_lines": Row({"none": lambda a: [0] * len(a)}, "", "crank"),
    "joint_axes": Row({"none": lambda a: [0] * len(a)}, "", "crank"),
    "joint_moving": Row({"none": lambda a: [0] * len(a)}, "", "pump"),
    "user_i": Row({"one": to([0])}, ""),
    "user_j": Row({"one": to([-1])}, ""),
}

RUNS: dict[str, Row] = {
    "run_id": Row({"another": to("0" * 16)}, "without a record"),
    "problem": Row({"none": to("")}, ""),
    "states": Row({"none": to("none"), "some": to("some steps")}, ""),
    "peaks_s": Row({"none": to({})}, "at its time"),
    "reactions": Row({"scaled": lambda a: {k: [2.0 * x for x in v] for k, v in a.items()}, "none": to({})}),
    "between": undecided("every step is there, also those around"),
    "arrays": Row({"none": to({}), "one less": lambda a: {k: a[k] for k in a if k != "state_reaction"}}, "series"),
}
HEAD: dict[str, Row] = {
    "format": Row({"another": to("x")}, "not a bundle"),
    "version": Row({"3": to(3)}, "not a bundle"),
    "lossless": Row({"false": to(False)}, "files"),
    "codes": Row({"none": to([])}),
}
PEAKS_UNDECIDED = ("scale ",)  # that such exact states are kept is all that these times are for
SERIES_DECIDED = (
    "t",
    "dt",
    "energy",
    "energy_error",
    "phi_norm",
    "phi_dot_norm",
    "eq81_norm",
    "orthogonality",
    "position_error",
    "orientation_error",
    "reference_own_error",
    "out_of_plane",
)
