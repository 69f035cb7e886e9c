"""The note under a figure: its runs, how they ended, the judged claims on it, and what the paper does not print."""

from collections.abc import Sequence
from pathlib import Path

from ...harness.files import FileError
from ...harness.places import Place
from ...harness.results.judgements.claims import Claim
from ...harness.results.judgements.files import FOLDER, PUBLISHED, read_claims
from ..model import claim_words, curves
from .captions import COLUMNS, Caption, CaptionClaim, CaptionRun
from .lines import Line
from .spec import PRINTED, Panel, PaperFigure

SPANS = (
    f"Lines pass through the smallest and largest value in each of {curves.SPANS_SIGNED} intervals of time, norms on "
    f"logarithmic axes through the largest in each of {curves.SPANS_UPPER}."
)


def caption(figure: PaperFigure, lines: Sequence[Line], folder: Path, files: Sequence[str]) -> Caption:
    """Caption of one figure; claims stand under the figure with the printed settings."""
    judged, published = judged_claims(folder)
    return Caption(
        number=figure.number, name=figure.name, label=figure.label, section=figure.section, title=figure.title,
        panels=tuple(p.title for p in figure.panels() if p.title),
        note=tuple(_note(figure, lines)), runs=tuple(map(_run, lines)),
        claims=tuple(_claim(c) for c in judged if figure.label == PRINTED and figure.number in c.figure),
        claims_published=published, files=tuple(files),
    )  # fmt: skip


def judged_claims(folder: Path) -> tuple[tuple[Claim, ...], bool]:
    """The claims judged by these results; the published ones, and True, where there are none that can be read."""
    try:
        own = read_claims(Place(folder) / FOLDER)
    except FileError:
        own = None
    return (read_claims(PUBLISHED) or (), True) if own is None else (own, False)


def _claim(c: Claim) -> CaptionClaim:
    tests = tuple((claim_words.format_measured(t), claim_words.band(t)) for t in c.tests)
    found = [(f.verdict, claim_words.share(f)) if f else ("", "") for f in (c.paper, c.beyond)]
    return CaptionClaim(c.id, c.quote, c.claim, claim_words.describe_missing(c), tests, *found)


def _note(figure: PaperFigure, lines: Sequence[Line]) -> list[str]:
    out = []
    for k in lines:
        run = k.chosen.run
        if run is None:
            out.append(f"Not in these results: {k.chosen.asked.case}.")
        elif not run.succeeded:
            how = run.status.replace("_", " ")
            if run.stopped:
                how = f"stops at {run.record.t_reached_s:.5g} s, {how}" if k.series is not None else f"no step, {how}"
            out.append(f"{k.chosen.name}: {how} ({run.reasons[0]}).")
    if figure.not_printed:
        out.append(f"The paper does not print: {'; '.join(figure.not_printed)}.")
    if any(isinstance(p, Panel) for p in figure.panels()):
        out.append(SPANS)
    return out


def _run(line: Line) -> CaptionRun:
    asked, run = line.chosen.asked, line.chosen.run
    what = line.chosen.role, asked.solver, asked.case, asked.settings_id
    if run is None:
        return CaptionRun(*what, found=False)
    columns = {name: getattr(run.record, name) for name in COLUMNS}
    return CaptionRun(*what, found=True, run_id=run.record.run_id, reasons=tuple(run.reasons), **columns)
