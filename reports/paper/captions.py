"""Write ``paper/captions.json``: runs, how they ended, the judged claims and open points of each figure.

Numbers that do not exist are null.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from ...harness.base.confined_paths import ConfinedPath, UnsafeFile
from ...harness.base.files import LARGEST, FileError, to_json
from ...harness.results.judgements import files
from ...harness.results.judgements.claims import JudgedClaim
from ..model import claim_words
from ..model.curves import SPANS_SIGNED, SPANS_UPPER
from .catalogue import PRINTED, Panel, PaperFigure
from .lines import PaperLine

FOLDER, FILE = "paper", "captions.json"
SPANS = (
    f"Lines pass through the smallest and largest value in each of {SPANS_SIGNED} intervals of time, norms on "
    f"logarithmic axes through the largest in each of {SPANS_UPPER}."
)
NUMBERS = (
    "t_reached_s",
    "t_end_s",
    "steps",
    "energy_start_J",
    "energy_drift_max_J",
    "energy_drift_end_J",
    "phi_max",
    "phi_dot_max",
    "position_error_max_m",
    "orientation_error_max_rad",
    "step_min_s",
    "step_max_s",
)


class CaptionRun(msgspec.Struct, frozen=True):
    """A requested run; its ``run_id`` is empty if the results do not have it."""

    role: str  # role of its solver in the paper
    solver: str
    asked: str  # its settings in words
    settings_id: str
    run_id: str = ""
    status: str = ""
    reasons: tuple[str, ...] = ()  # why it is not a success
    numbers: dict[str, float | None] = {}  # numbers of its record, by column


class CaptionClaim(msgspec.Struct, frozen=True):
    """A claim on the figure with its verdicts and how many settings each holds in; empty if there are none."""

    id: str
    quote: str
    claim: str
    missing: str  # why it cannot be tested
    tests: tuple[tuple[str, str], ...]  # pairs of measured value and band
    paper: tuple[str, str]  # at the settings that the paper prints
    beyond: tuple[str, str]


class Caption(msgspec.Struct, frozen=True):
    """The texts about one figure."""

    number: int
    name: str
    label: str
    section: str
    title: str
    panels: tuple[str, ...]
    note: tuple[str, ...]
    runs: tuple[CaptionRun, ...]
    claims: tuple[CaptionClaim, ...]
    claims_published: bool  # the verdicts are the published ones, since the results are not judged
    files: tuple[str, ...]


class Captions(msgspec.Struct, frozen=True):
    """The contents of ``captions.json``."""

    run: str
    commit: str
    figures: tuple[Caption, ...]


def read_captions(folder: Path) -> tuple[Caption, ...]:
    """Read the captions of figures drawn from the results in ``folder``; empty without a file of this format.

    Raise UnsafeFile for a link or a device in its place.
    """
    try:
        return msgspec.json.decode((ConfinedPath(folder) / FOLDER / FILE).read(LARGEST), type=Captions).figures
    except UnsafeFile:
        raise
    except (OSError, ValueError, RecursionError):
        return ()


def write_captions(folder: Path, environment: Any, drawn: list[Caption], order: list[str]) -> None:
    """Write the captions of the figures ``drawn`` now, and keep those of other figures that were drawn earlier.

    ``order`` are the names of all figures, in order; ``environment`` is the results' stamp.
    """
    new = {c.name for c in drawn}
    every = [*(c for c in read_captions(folder) if c.name in order and c.name not in new), *drawn]
    figures = tuple(sorted(every, key=lambda c: order.index(c.name)))
    whole = Captions(folder.name, str(environment.get("commit", "")), figures)
    (ConfinedPath(folder) / FOLDER / FILE).write(to_json(whole, indent=1))


def make_caption(figure: PaperFigure, lines: Sequence[PaperLine], folder: Path, written: Sequence[str]) -> Caption:
    """Return the caption of one figure drawn from the results in ``folder``; ``written`` are the names of its files.

    Only the figure with the printed settings has claims: those judged by these results, or the published ones if they
    are not judged.
    """
    try:
        judged = files.read_claims(ConfinedPath(folder) / files.FOLDER)
    except FileError:
        judged = None
    claims = files.read_claims(files.PUBLISHED) or () if judged is None else judged
    return Caption(
        number=figure.number,
        name=figure.name,
        label=figure.label,
        section=figure.section,
        title=figure.title,
        panels=tuple(p.title for p in figure.panels() if p.title),
        note=tuple(_write_notes(figure, lines)),
        runs=tuple(map(_caption_run, lines)),
        claims=tuple(_caption_claim(c) for c in claims if figure.label == PRINTED and figure.number in c.figure),
        claims_published=judged is None,
        files=tuple(written),
    )


def _caption_claim(c: JudgedClaim) -> CaptionClaim:
    """Return a judged claim in the words of the caption."""
    tests = tuple((claim_words.format_measured(t), claim_words.format_band(t)) for t in c.tests)
    found = [(f.verdict, claim_words.format_condition_and_share(f)) if f else ("", "") for f in (c.paper, c.beyond)]
    return CaptionClaim(c.id, c.quote, c.claim, claim_words.describe_missing(c), tests, *found)


def _write_notes(figure: PaperFigure, lines: Sequence[PaperLine]) -> list[str]:
    """Return sentences on missing and failed runs, on what the paper does not print, and on how lines are reduced."""
    out = []
    for k in lines:
        run = k.run
        if run is None:
            out.append(f"Not in these results: {k.asked.case}.")
        elif not run.is_success:
            how = run.status.replace("_", " ")
            if run.has_stopped:
                how = f"stops at {run.record.t_reached_s:.5g} s, {how}" if k.series is not None else f"no step, {how}"
            out.append(f"{k.role}, {k.settings}: {how} ({run.reasons[0]}).")
    if figure.not_printed:
        out.append(f"The paper does not print: {'; '.join(figure.not_printed)}.")
    if any(isinstance(p, Panel) for p in figure.panels()):
        out.append(SPANS)
    return out


def _caption_run(line: PaperLine) -> CaptionRun:
    """Return a requested run for the caption: how it ended, and its numbers; neither if it is not in the results."""
    asked, run = line.asked, line.run
    names = line.role, asked.solver, asked.case, asked.settings_id
    if run is None:
        return CaptionRun(*names)
    numbers = {name: getattr(run.record, name) for name in NUMBERS}
    return CaptionRun(*names, run.record.run_id, run.record.status, tuple(run.reasons), numbers)
