"""Select the series of a run that judgements read at every step; results folders keep envelopes of all others."""

from collections.abc import Callable, Iterable

from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec
from .certificates.drift import READS, is_long
from .claims.frame import find_default_duration, is_in, read_dimensions
from .claims.measures import list_series_read
from .claims.register import Register


def make_series_selector(register: Register, tried: Iterable[RunSpec]) -> Callable[[RunSpec], set[str]]:
    """Return a function that tells which series of a run are needed at every step, by claims or for its drift.

    ``tried`` are the runs that claims of the register may be tried on.
    """
    known = {s.settings_id for s in tried}
    maps = [
        (m.over, {s for t in c.tests for s in list_series_read(t.metric, t.arguments)})
        for c in register.claims
        for m in c.maps
        if m
    ]

    def read(spec: RunSpec) -> set[str]:
        """Return the names, or patterns, of the series of the run ``spec`` that are needed at every step."""
        if not registry.is_own_problem(spec.problem):  # a plugin's problem is only made where limits hold
            return set(READS)
        t_end = spec.parameters.get("t_end") or find_default_duration(spec.problem)
        out = set(READS) if is_long(spec.label, t_end) else set[str]()
        if spec.settings_id not in known:
            return out
        here = read_dimensions(spec)
        return out.union(*(series for over, series in maps if not series <= out and is_in(here, over)))

    return read
