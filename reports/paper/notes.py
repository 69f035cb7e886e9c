"""The note under a figure: settings, how each run ended, what the paper says beside what is measured, what is open."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..model import curves
from .lines import Line
from .measures import Fact, measured
from .picking import asked_for, settings_of
from .printed import JACOBIANS, role
from .spec import Panel, PaperFigure

COLUMNS = (
    "status", "t_reached_s", "t_end_s", "steps", "energy_start_J", "energy_drift_max_J", "energy_drift_end_J",
    "phi_max", "phi_dot_max", "position_error_max_m", "orientation_error_max_rad", "step_min_s", "step_max_s",
)  # fmt: skip
SPANS = (
    f"Lines go through the smallest and largest value of each of {curves.SPANS_SIGNED} spans of time, norms on "
    f"logarithmic axes through the largest of {curves.SPANS_UPPER}."
)


@dataclass(frozen=True)
class Caption:
    """All that is said about a figure, as it goes into captions.json."""

    number: int
    name: str
    variant: str
    section: str
    title: str
    panels: list[str]
    note: list[str]
    differs: list[str]  # sentences of the note where a run ends otherwise than the paper says
    settings: list[str]
    runs: list[dict[str, Any]]
    facts: list[dict[str, Any]]
    claims: list[dict[str, str]]
    files: list[str]


def caption(spec: PaperFigure, lines: Sequence[Line], claims: Sequence[Mapping[str, Any]], files: list[str]) -> Caption:
    """Of one figure; ``claims`` are those of the run's judgement, if there is one."""
    facts = [measured(s, lines) for s in spec.says]
    judged = [_claim(c) for c in claims if about(c, spec.number)] if spec.variant == "as printed" else []
    return Caption(
        spec.number,
        spec.name,
        spec.variant,
        spec.section,
        spec.title,
        [p.title for p in spec.panels() if p.title],
        _note(spec, lines, facts),
        [f.text for f in facts if f.differs],
        [f"{role(k.chosen.pick)}: {asked_for(k.chosen.pick)}" for k in lines],
        [_run(k) for k in lines],
        [asdict(f) for f in facts],
        judged,
        files,
    )


def _note(spec: PaperFigure, lines: Sequence[Line], facts: Sequence[Fact]) -> list[str]:
    out = [f.text for f in facts]
    told = {key for s in spec.says if s.measure == "end" for key in s.picks}
    for k in lines:
        run = k.chosen.run
        if run is None:
            out.append(f"Not in this run: {k.name} ({asked_for(k.chosen.pick)}).")
        elif not run.succeeded and k.key not in told:
            how = run.status.replace("_", " ")
            if run.stopped:
                how = f"stops at {run.record.t_reached_s:.5g} s, {how}" if k.series is not None else f"no step, {how}"
            out.append(f"{k.name}: {how}: {run.reasons[0]}.")
    if spec.not_printed:
        out.append(f"Not given by the paper: {'; '.join(spec.not_printed)}.")
    if spec.variant == "as printed" and any(s.measure == "end" for s in spec.says):
        out.append(JACOBIANS)
    if any(isinstance(p, Panel) for p in spec.panels()):
        out.append(SPANS)
    return out


def claims_of(folder: Path) -> list[dict[str, Any]]:
    """The judged claims of a run; none before it is judged, or where the file is not what it should be."""
    try:
        found = json.loads((folder / "judgement" / "claims.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return [c for c in found if isinstance(c, dict)] if isinstance(found, list) else []


def about(claim: Mapping[str, Any], figure: int) -> bool:
    """Whether the claim's figure, ``"Fig. 9a"`` or ``"Figs. 2, 3"`` or a number, is this one."""
    return str(figure) in re.findall(r"\d+", str(claim.get("figure", "")))


def _claim(claim: Mapping[str, Any]) -> dict[str, str]:
    return {k: str(claim.get(k, "")) for k in ("id", "claim", "verdict", "because")}


def _run(line: Line) -> dict[str, Any]:
    pick, run = line.chosen.pick, line.chosen.run
    out: dict[str, Any] = {
        "key": line.key, "role": role(pick), "solver": pick.solver, "settings": settings_of(pick),
        "asked": asked_for(pick), "found": run is not None, "run": "", "settings_digest": "", "reasons": [],
    }  # fmt: skip
    if run is not None:
        out |= {"run": run.record.run_id, "settings_digest": run.record.settings_id, "reasons": list(run.reasons)}
        out |= {name: getattr(run.record, name) for name in COLUMNS}
    return out


def jsonable(value: Any) -> Any:
    """NaN and infinities as null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: jsonable(v) for k, v in value.items()}
    return [jsonable(v) for v in value] if isinstance(value, list | tuple) else value
