"""How runs ended, counted; and which variants are the problems themselves, not presented otherwise or varied."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .accuracy import drifts, measure_for
from .results import Results, Run, Variant, by_solver, group_by
from .words import cut, join_words, mark, plural

KINDS = {  # of marks, in words
    "good": "succeeded", "inaccurate": "inaccurate", "wrong": "wrong", "failed": "stopped", "refused": "refused"
}  # fmt: skip
REASON = 90  # characters of a reason
HEADLINE = ("recommended", "default")  # labels of a suite's plain comparison
PRESENTED = {
    "yaw": "turned about the vertical",
    "rotation": "turned in space",
    "mirror": "as a mirror image",
    "renumber": "with bodies and joints renumbered",
    "duplicate": "with a joint declared twice",
    "unit_length": "in another unit of length",
    "unit_mass": "in another unit of mass",
    "unit_time": "in another unit of time",
    "retrace": "run backwards from the end",
    "perturb": "from a slightly perturbed start",
}  # parameters that every problem has and that change no motion, or hardly
SAME_MOTION = ("mirror", "renumber", "duplicate", "unit_length", "unit_mass", "unit_time", "retrace")
OTHER_PARAMETERS = "other end times, sizes and releases"


@dataclass(frozen=True)
class Score:
    """Numbers of runs, those that did not finish here left out; ``bounded`` and ``drifting``: successes whose energy
    error tells.
    """

    succeeded: int
    inaccurate: int
    wrong: int
    stopped: int
    refused: int
    bounded: int
    drifting: int

    @property
    def runs(self) -> int:
        return sum(getattr(self, name) for name in KINDS.values())

    @property
    def began(self) -> int:
        """Refusals left out: how many might have stopped."""
        return self.runs - self.refused

    @property
    def shares(self) -> list[tuple[str, int, float]]:
        """Kind, count and percent of all, for a bar."""
        return [(kind, n, 100.0 * n / self.runs) for kind, name in KINDS.items() if (n := getattr(self, name))]

    @property
    def words(self) -> str:
        """``5 succeeded, 1 wrong``."""
        return join_words([f"{n} {name}" for name in KINDS.values() if (n := getattr(self, name))]) or "no run"


def score(runs: Iterable[Run]) -> Score:
    """Score of any runs."""
    own = list(runs)
    kinds = Counter(mark(c.status).kind for c in own)
    energy = Counter(drifts(c) for c in own if c.succeeded)
    ended = {name: kinds[kind] for kind, name in KINDS.items()}
    return Score(**ended, bounded=energy[False], drifting=energy[True])


def standings(results: Results) -> list[dict[str, Any]]:
    """Outcomes of each solver's finest settings on the problems of the plain comparison, and of all its runs.

    Whose finest settings succeed on most problems is first; equals by name.
    """
    label, out = broadest(results), []
    variants = themselves(results, label)
    for solver, own in by_solver(results.runs).items():
        stands = [(p, h) for p in variants if (h := finest(p, solver, label)) is not None]
        heads = [h for _, h in stands]
        failures = [(p, c) for p, c in stands if not (c.succeeded or c.unfinished)]
        out.append({
            "solver": solver, "paper_label": ", ".join(dict.fromkeys(r.record.paper_label for r in heads or own[:1])),
            "finest": score(heads), "everything": score(own),
            "breaks_on": [(c, cut(c.reasons[0], REASON) + _finer(p, c)) for p, c in failures],
        })  # fmt: skip
    return sorted(
        out, key=lambda v: (-(v["finest"].succeeded / v["finest"].runs if v["finest"].runs else -1.0), v["solver"])
    )


def finest(variant: Variant, solver: str, label: str) -> Run | None:
    """The run that stands for a solver on a problem: the smallest step or tolerance, fewest options."""
    own = [c for c in variant.runs if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: c.finest_first, default=None)


def _finer(variant: Variant, run: Run) -> str:
    """Words for a finer step or tolerance at which the same settings succeed, in whatever group that was run."""
    own = [c for c in variant.runs if c.method == run.method and c.succeeded]
    finer = [c for c in own if c.step_or_tolerance < run.step_or_tolerance]
    best = max(finer, key=lambda c: c.step_or_tolerance, default=None)
    return f"; succeeds at {best.step_words}" if best else ""


def unpredictable(results: Results) -> str:
    """On what problems of the plain comparison errors are judged over a part of the time only."""
    variants = themselves(results, broadest(results))
    found = [(p, m.until) for p in variants if (m := measure_for(p.runs)) and m.until is not None]
    parts = [f"{p.title} to {until:.2g} of {max(c.record.t_end_s for c in p.runs):g} s" for p, until in found]
    return f"Errors are judged while the motion is predictable: {join_words(parts)}." if parts else ""


def presentation(variant: Variant) -> str:
    """How the problem is presented; empty where it is as its file has it."""
    return next((words for key, words in PRESENTED.items() if key in variant.runs[0].parameters), "")


def same_motion(variant: Variant) -> bool:
    """The motion is that of another variant: only its presentation differs, and is undone before measuring."""
    return any(key in variant.runs[0].parameters for key in SAME_MOTION)


def broadest(results: Results) -> str:
    """The label of the plain comparison, else the one under which most pairs of a problem as it is and a solver ran."""
    labels = results.labels()
    for name in HEADLINE:
        if name in labels:
            return name
    plain = [p for p in results.variants if not presentation(p)]
    pairs = {(c.record.label, p.title, c.record.solver) for p in plain for c in p.runs}
    count = Counter(label for label, _, _ in pairs)
    return max(labels, key=count.__getitem__, default="")


def themselves(results: Results, label: str) -> tuple[Variant, ...]:
    """The variants of ``label``; of a problem that has none there, all that are presented as they are."""
    own = {p.title: p for p in results.variants if any(c.record.label == label for c in p.runs)}
    there = {p.problem for p in own.values()}
    return tuple(p for p in results.variants if p.title in own or (p.problem not in there and not presentation(p)))


def variant_groups(results: Results, label: str) -> dict[str, list[Variant]]:
    """All others, by how they differ; the same problems at other times and sizes first."""
    here = {p.title for p in themselves(results, label)}
    others = [p for p in results.variants if p.title not in here]
    apart = group_by(others, lambda p: presentation(p) or OTHER_PARAMETERS)
    return {words: apart[words] for words in (OTHER_PARAMETERS, *PRESENTED.values()) if words in apart}


def groups_of(variant: Variant, label: str) -> dict[str, tuple[Run, ...]]:
    """The runs by label: those of the plain comparison first, then the largest group."""
    found = variant.labels()
    return {k: found[k] for k in sorted(found, key=lambda name: name != label)}


def mechanisms(results: Results) -> str:
    """How many problems there are, and of how many the exact motion is known."""
    known = {c.record.problem for c in results.runs if c.record.reference}
    count = len({c.record.problem for c in results.runs})
    if len(known) == count:
        return f"{plural(count, 'mechanism')} whose exact motion is known"
    return f"{plural(count, 'mechanism')}, {len(known)} of known exact motion"


def plain_runs(variant: Variant, label: str) -> tuple[Run, ...]:
    """Those that speak for a problem: of ``label``, else those at default options, else all."""
    own = tuple(c for c in variant.runs if c.record.label == label)
    return own or tuple(c for c in variant.runs if not c.options) or variant.runs
