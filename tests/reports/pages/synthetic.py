"""Judgements made by hand: every verdict, numbers that do not exist, and texts that attack."""

import math
from collections.abc import Sequence
from pathlib import Path

from msgspec.structs import replace

from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.judgements.claims import (
    ClaimFinding,
    ClaimGap,
    ClaimVerdict,
    CodeDigests,
    Condition,
    Decision,
    Ending,
    ExcludedSettings,
    JudgedClaim,
    JudgedTest,
    MapRow,
    MissingReason,
    MovedVerdict,
    SettingsCount,
    VerdictEvidence,
)
from mbsbench.harness.results.judgements.files import (
    CLAIMS,
    DRIFTS,
    FIELD_CLAIMS,
    ORDERS,
    SYMMETRIES,
    WORK,
    WRONG,
    add_code,
    format_judgement,
)
from mbsbench.harness.results.judgements.runs import Drift, FalseSuccess, Order, Symmetry, Work, WorkPoint, WorkProfile

from ..conftest import HOSTILE

NAN = math.nan
TEST = JudgedTest("largest", {"series": "x"}, "", "", "m", (0.0, 0.05), 0.02)
CLAIM = JudgedClaim(
    "c",
    "result",
    "5.2",
    (6, 7),
    "failed to run further at about 32 s",
    "A claim",
    None,
    ClaimFinding(ClaimVerdict.REPRODUCED, 1, 1, 1),
    (TEST,),
    (0.02, 0.02),
    VerdictEvidence(),
    (),
    (),
    {"tolerance": (1e-3,)},
    (),
    (),
    {},
    (),
)
CODE = CodeDigests({}, {}, "", "", "")
ROW = MapRow("aa01", "case", 0, {"tolerance": 1e-3, "gain": 5.0}, True, 0.5, "success", False)
ORDER = Order(
    "pendulum",
    "pendulum",
    "alpha",
    "alpha",
    "q",
    "|q|",
    "m",
    "dt",
    2.0,
    NAN,
    NAN,
    NAN,
    (),
    (),
    (),
    NAN,
    (),
    NAN,
    NAN,
    NAN,
    "undecided",
    "none",
    (),
    0,
    (),
    2.0,
    (),
)
DRIFT = Drift("pendulum", "pendulum", "alpha", "pendulum alpha", "aa01", "success", "bounded", 600.0, 400, 1e-3, 1e-9,
              -1e-9, 3e-9, 1e-8, 0.0, 2e-8)  # fmt: skip
SYMMETRY = Symmetry(
    "alpha",
    {},
    "yaw",
    "pendulum",
    "pendulum",
    ("aa01",),
    "holds",
    deviation=1e-9,
    bound=1e-6,
    exact_bound=1e-6,
    level=1e-7,
    halved=0.0,
    rounding=1e-12,
    growth=1.0,
)
POINT = WorkPoint(
    "pendulum",
    "pendulum",
    "alpha",
    "pendulum alpha",
    "aa01",
    "recommended",
    False,
    "success",
    1.0,
    "position error",
    "m",
    1.0,
    0.0,
    0.1,
    100,
    300.0,
    NAN,
    310.0,
    1e-9,
)


def claims(runs: Sequence[str]) -> tuple[JudgedClaim, ...]:
    """One of each verdict, one of the abstract, one with a map of charts and starts, a check of the set-up, attacks."""
    at = tuple(
        MapRow(
            runs[k % len(runs)],
            f"case {k}",
            0,
            {
                "tolerance": tolerance,
                "gain": gain,
                "form": "fi",
                "chart": chart,
                "lambda_in_error_test": True,
                "consistent_start": start,
                "frame": "aligned",
            },
            None if k % 7 == 6 else (tolerance < 1e-4 or gain == 0.0),
            0.01 * k,
            "step_underflow" if k % 5 == 4 else "success",
            k == 0,
        )
        for k, (chart, start, tolerance, gain) in enumerate(
            (c, s, t, g)
            for c in ("euler313", "quaternion")
            for s in (True, False)
            for t in (1e-3, 1e-5, 1e-7)
            for g in (0.0, 5.0, 20.0, "1/h")
        )
    )
    left = sum(m.holds is None for m in at)
    mixed = ClaimFinding(
        ClaimVerdict.REPRODUCED_IF,
        sum(m.holds is True for m in at) - 1,
        len(at) - left - 3,
        len(at) - left - 1,
        1,
        Decision(
            {},
            False,
            (Condition({"gain": 0.0}, 6, 6), Condition({"chart": HOSTILE}, 0, 2)),
            "gain",
            told=(SettingsCount(0.0, 6, 6), SettingsCount(5.0, 2, 6)),
        ),
        (MovedVerdict(0, "wider", ClaimVerdict.REPRODUCED, 9, 9),),
        (ExcludedSettings(Ending.SLOW, left),),
    )

    def claim(name: str, verdict: str, **more: object) -> JudgedClaim:
        words, found = (
            f"A claim that is {verdict.lower()}",
            {"beyond": ClaimFinding(ClaimVerdict(verdict), 1, 1, 1), **more},
        )
        return replace(CLAIM, id=name, claim=words, settings_ids=tuple(runs[:2]), **found)

    needs = (MissingReason(ClaimGap.NEED, "the commercial code"), MissingReason(ClaimGap.RUNS, "case 3", "m", 2, 5))
    return (
        claim("first-claim", "reproduced"),
        claim(
            "second-claim",
            "not reproduced",
            tests=(replace(TEST, measured=3.0, band=(None, 0.05)),),
            section="5.4",
            summary=True,
            map=(
                replace(ROW, holds=False, measured=7.0, command="mbsbench solve pendulum beta"),
                replace(ROW, holds=False, measured=3.0, command="mbsbench solve pendulum alpha"),
            ),
        ),
        claim(
            "conditional-claim",
            "reproduced if",
            beyond=ClaimFinding(ClaimVerdict.REPRODUCED_IF, 2, 4, 4, 0, Decision({"gain": (0.0, 5.0)})),
        ),
        claim(
            "third-claim",
            "reproduced if",
            map=at,
            measured_range=(0.001, 0.4),
            paper=ClaimFinding(ClaimVerdict.NOT_REPRODUCED, 0, 1, 1),
            beyond=mixed,
            factors={
                "gain": (SettingsCount(0.0, 6, 6), SettingsCount(5.0, 2, 6)),
                HOSTILE: (SettingsCount(HOSTILE, 1, 2),),
            },
            tests=(TEST, JudgedTest(HOSTILE, {}, HOSTILE, "", HOSTILE, (1.0, None), NAN, unbounded=True)),
        ),
        replace(
            claim(
                "fourth-claim",
                "cannot be told",
                missing=needs,
                section="5.3",
                tests=(),
                settings={},
                measured_range=(),
                beyond=ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD),
            ),
            settings_ids=(),
        ),
        claim("presentation-claim", "reproduced", kind="presentation"),
        replace(
            claim(
                HOSTILE,
                "reproduced",
                section=HOSTILE,
                quote=HOSTILE,
                settings={HOSTILE: (HOSTILE,)},
                against=(HOSTILE,),
                caveats=(HOSTILE,),
                map=(MapRow(HOSTILE, HOSTILE, 0, {"form": HOSTILE}, True, NAN, HOSTILE, False),),
            ),
            claim=HOSTILE,
            settings_ids=(HOSTILE, "unknown"),
        ),
    )


def field(runs: Sequence[str]) -> tuple[JudgedClaim, ...]:
    """A statement of a textbook that one of two settings bears out, and an attack."""
    some = ClaimFinding(ClaimVerdict.REPRODUCED_IF, 1, 2, 2, 0, Decision({"gain": (5.0,)}))
    own = replace(
        CLAIM, register="field", figure=(), settings_ids=tuple(runs[:1]), map=(ROW, replace(ROW, holds=False))
    )
    book = replace(own, id="field-claim", section="A. Author, A book (1996), Sect. 1", quote="It grows.", beyond=some)
    hostile = replace(own, id=f"field {HOSTILE}", section=HOSTILE, quote=HOSTILE, claim=HOSTILE)
    return book, replace(hostile, map=(replace(ROW, measured=0.02, command=HOSTILE),))


def orders(runs: Sequence[str]) -> tuple[Order, ...]:
    """Second order with a coarse step too many, first order below the declared one, the floor, a refusal, an attack."""
    dts = (0.04, 0.02, 0.01, 0.005, 0.0025)
    square = tuple(d**2 for d in dts)

    def row(quantity: str, errors: tuple[float, ...], used: tuple[bool, ...], order: float, **more: object) -> Order:
        found = {"verdict": "certified", "fit": "power", "settings_ids": tuple(runs[:2])} | more
        return replace(
            ORDER,
            quantity=quantity,
            order=order,
            low=order - 0.02,
            high=order + 0.02,
            dt=dts,
            error=errors,
            used=used,
            floor=1e-12,
            **found,
        )

    return (
        row("q", (10.0 * square[0], *square[1:]), (False, True, True, True, True), 2.0),
        row("v", tuple(0.1 * d for d in dts), (True,) * 5, 1.0, verdict="below declared", solver="beta"),
        row("energy", (1e-13,) * 5, (False,) * 5, NAN, verdict="exact", fit="exact", unit="J"),
        replace(
            ORDER,
            quantity="q",
            solver="gamma",
            case="gamma",
            verdict="refused",
            order=NAN,
            low=NAN,
            high=NAN,
            dt=(),
            error=(),
            used=(),
            slopes=(),
            settings_ids=(),
            status="refused",
            message=f"no springs {HOSTILE}",
        ),
        replace(
            ORDER,
            variant=HOSTILE,
            solver=HOSTILE,
            case=HOSTILE,
            quantity=HOSTILE,
            symbol=HOSTILE,
            unit=HOSTILE,
            settings_ids=(HOSTILE,),
        ),
    )


def drift(runs: Sequence[str]) -> tuple[Drift, ...]:
    """A swing, a line, a run that failed with a text that attacks."""
    return (
        replace(DRIFT, settings_id=runs[0]),
        replace(DRIFT, solver="beta", verdict="trend", trend_W=-1e-5, trend_low_W=-1.1e-5, trend_high_W=-0.9e-5),
        replace(
            DRIFT,
            variant=HOSTILE,
            solver=HOSTILE,
            case=HOSTILE,
            status=HOSTILE,
            verdict="failed",
            periods=0,
            oscillation_J=NAN,
            trend_W=NAN,
            trend_low_W=NAN,
            trend_high_W=NAN,
            walk_J_per_sqrt_s=NAN,
            walk_low=NAN,
            walk_high=NAN,
        ),
    )


def symmetries(runs: Sequence[str]) -> tuple[Symmetry, ...]:
    """Every verdict, two problems in one box."""

    def row(solver: str, check: str, verdict: str, variant: str = "pendulum", **more: object) -> Symmetry:
        made = replace(SYMMETRY, solver=solver, check=check, variant=variant, settings_ids=tuple(runs[:1]), **more)
        return replace(made, verdict=verdict)

    failed = {"unjudged": "presented run", "status": "refused", "message": HOSTILE}
    return (
        row("alpha", "time reversal", "holds", exact=True, halved=1e-3),
        row("alpha", "time reversal", "broken", "chain"),
        row("alpha", "yaw", "holds"),
        row("beta", "time reversal", "failed", **failed),
        row("beta", "yaw", "refused", **failed),
        row("gamma", "yaw", "not applicable", unjudged="single body"),
        row(HOSTILE, HOSTILE, "undecided", HOSTILE),
    )


def work(runs: Sequence[str]) -> Work:
    """Three points of one solver, the best one among them, an attack; a profile of two solvers."""
    points = [
        replace(
            POINT,
            case=f"pendulum alpha {k}",
            settings_id=runs[k % len(runs)],
            best=k == 2,
            error=10.0**-k,
            energy_drift_J=10.0**-k,
            cpu_s=0.1 * 2**k,
            steps=100 * 2**k,
            evaluations=300.0 * 2**k,
            operations=310.0 * 2**k,
        )
        for k in range(3)
    ]
    attack = dict.fromkeys(
        ("problem", "variant", "solver", "case", "label", "error_kind", "unit", "settings_id"), HOSTILE
    )
    profile = (
        WorkProfile("alpha", "evaluations", 4, (10.0, 100.0, 1000.0)),
        WorkProfile("beta", "evaluations", 4, (20.0,)),
        WorkProfile(HOSTILE, "evaluations", 4, ()),
    )
    return Work((*points, replace(POINT, **attack)), profile, (), ())


def wrong(runs: Sequence[str]) -> tuple[FalseSuccess, ...]:
    """One known run, one unknown with an attack."""
    hot = Reason(Law.ENERGY, 3.0, 1.0, "J")
    return (
        FalseSuccess("pendulum beta", runs[0], "beta", "pendulum", (hot,)),
        FalseSuccess(HOSTILE, HOSTILE, HOSTILE, HOSTILE, (Reason(Law.SYMMETRY, 1.0, 0.5, "m", name=HOSTILE),)),
    )


FILES = (
    (CLAIMS, claims),
    (FIELD_CLAIMS, field),
    (ORDERS, orders),
    (DRIFTS, drift),
    (SYMMETRIES, symmetries),
    (WORK, work),
    (WRONG, wrong),
)


def judge(folder: Path, runs: Sequence[str]) -> None:
    """All files of ``<results>/judgement/``."""
    where = folder / "judgement"
    where.mkdir(parents=True, exist_ok=True)
    for file, make in FILES:
        made = make(runs)
        text = format_judgement(add_code(made, CODE) if file.schema else made)
        (where / f"{file.name}.json").write_text(text, encoding="utf-8")
