"""Separate the problems themselves from their presentations and other parameters, and select their main runs."""

from collections import Counter

from ...harness.mechanics.types.presentations import PRESENTATIONS
from .results import StoredResults, StoredRun, Variant, group_by
from .words import plural

HEADLINE = ("recommended", "default")  # labels of a suite's plain comparison
PRESENTED = {p.name: p.words for p in PRESENTATIONS} | {
    "perturb": "from a slightly perturbed start",
}  # parameters of every problem that change the motion not at all, or only slightly
SAME_MOTION = tuple(p.name for p in PRESENTATIONS if p.undone)
OTHER_PARAMETERS = "other end times, sizes and releases"


def describe_presentation(variant: Variant) -> str:
    """Describe how a variant presents its problem (mirrored, perturbed, ...); empty if as in the problem's file."""
    return next((words for key, words in PRESENTED.items() if key in variant.runs[0].parameters), "")


def has_same_motion(variant: Variant) -> bool:
    """Return whether a variant has the motion of another one, since its presentation is undone before measuring."""
    return any(key in variant.runs[0].parameters for key in SAME_MOTION)


def find_plain_label(results: StoredResults) -> str:
    """Return the label of the plain comparison.

    It is one of ``HEADLINE``, else the label with most pairs of an unpresented problem and a solver.
    """
    labels = results.labels()
    for name in HEADLINE:
        if name in labels:
            return name
    plain = [p for p in results.variants if not describe_presentation(p)]
    pairs = {(c.record.label, p.title, c.record.solver) for p in plain for c in p.runs}
    count = Counter(label for label, _, _ in pairs)
    return max(labels, key=count.__getitem__, default="")


def select_variants(results: StoredResults, label: str) -> tuple[Variant, ...]:
    """Return the variants with runs under ``label``; for a problem without any, all its unpresented variants."""
    own = {p.title: p for p in results.variants if any(c.record.label == label for c in p.runs)}
    covered = {p.problem for p in own.values()}
    return tuple(
        p for p in results.variants if p.title in own or (p.problem not in covered and not describe_presentation(p))
    )


def group_variants(results: StoredResults, label: str) -> dict[str, list[Variant]]:
    """Group the variants outside the plain comparison by how they differ, in words; other parameters come first."""
    main = {p.title for p in select_variants(results, label)}
    others = [p for p in results.variants if p.title not in main]
    groups = group_by(others, lambda p: describe_presentation(p) or OTHER_PARAMETERS)
    return {words: groups[words] for words in (OTHER_PARAMETERS, *PRESENTED.values()) if words in groups}


def group_by_label(variant: Variant, label: str) -> dict[str, tuple[StoredRun, ...]]:
    """Return the runs of a variant by label: those of ``label`` first, then the largest group."""
    found = variant.labels()
    return {k: found[k] for k in sorted(found, key=lambda name: name != label)}


def format_problem_counts(results: StoredResults) -> str:
    """Return words on the number of problems and how many of them have a known exact motion."""
    known = {c.record.problem for c in results.runs if c.record.reference}
    count = len({c.record.problem for c in results.runs})
    if len(known) == count:
        return f"{plural(count, 'mechanism')} whose exact motion is known"
    return f"{plural(count, 'mechanism')}, {len(known)} of known exact motion"


def select_plain_runs(variant: Variant, label: str) -> tuple[StoredRun, ...]:
    """Return the main runs of a variant: those under ``label``, else those with default options, else all."""
    own = tuple(c for c in variant.runs if c.record.label == label)
    return own or tuple(c for c in variant.runs if not c.options) or variant.runs
