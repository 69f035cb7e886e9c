"""Which solvers a chart shows in colour: the best, the worst and the best of each family, seven at most."""

from collections.abc import Callable, Iterable, Sequence

MOST = 7


def choose_focus(best_first: Sequence[str], family: Callable[[str], str], first: Iterable[str] = ()) -> tuple[str, ...]:
    """``first``, the best and the worst, then the best of every family, then the next best."""
    order = list(dict.fromkeys(best_first))
    ends = [*order[:1], *order[-1:]]
    seen: dict[str, str] = {}
    for name in order:
        seen.setdefault(family(name), name)
    return tuple(dict.fromkeys([*(n for n in first if n in order), *ends, *seen.values(), *order]))[:MOST]
