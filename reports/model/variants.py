"""Which variants are the problems themselves, not presented otherwise or varied, and which runs speak for them."""

from collections import Counter

from .results import Results, Run, Variant, group_by
from .words import plural

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
