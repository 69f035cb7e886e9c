"""Carry published results over to later code that gives the same numbers, bit for bit, as runs by both have shown.

A digest changes with every name in the code. Published results stay valid for code whose runs have the same bits:
``docs/carry_over.py`` makes suite ``ci`` and a hundred runs of suite ``referee`` by an earlier commit and by the
present code, judges both, and records in ``results/published/carried.json`` the digests of both for solvers whose runs
are all equal, and the digests of judging if all verdicts and counts are equal.
"""

from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import msgspec

from ...base.confined_paths import ConfinedPath
from ...base.files import parse_json, read_text
from ...base.shapes import Shape, convert_shape
from ...catalogue import codes
from ...columns.digests import ColumnDigests
from ...results.judgements.claims import CodeDigests
from ...results.judgements.files import PUBLISHED
from .currency import JUDGING

FILE = PUBLISHED / "carried.json"


class Generation(Shape, frozen=True):
    """The digests of one state of the code."""

    solvers: dict[str, str]  # digest of the code of each solver, by its name
    problems: dict[str, str]  # digest of the code of each problem, by its name
    measuring: str  # digest of the code that measures motions; in older states of all that runs and measures
    judging: str = ""  # digest of the code that judges claims; empty if not compared
    commit: str = ""
    shown: str = ""  # the runs with equal bits in this and the following generation
    running: str = ""  # digest of the code that runs solvers; empty in older states
    # digest of the function of each column, by its name; empty in older states
    columns: dict[str, str] = msgspec.field(default_factory=dict)

    @property
    def measured(self) -> ColumnDigests:
        """The digests of what measures: of the series and of each column."""
        return ColumnDigests(self.measuring, self.columns)

    def has_equal_run_digests(self, other: "Generation") -> bool:
        """Return whether ``other`` has the same digests of all that runs depend on; those of judging may differ.

        It may have more columns: a column that is added changes no other.
        """
        same = all(getattr(self, k) == getattr(other, k) for k in ("solvers", "problems", "running", "measuring"))
        return same and self.columns.items() <= other.columns.items()

    def includes(self, code: CodeDigests) -> bool:
        """Return whether ``code``, the digests that published verdicts record, are those of this state of the code.

        The digest of judging may differ; solvers, problems and columns that the verdicts do not have are not compared.
        """
        parts = ((code.solvers, self.solvers), (code.problems, self.problems), (code.columns, self.columns))
        same = (code.running, code.measuring) == (self.running, self.measuring)
        return same and all(own.items() <= known.items() for own, known in parts)

    def digest_run_code(self, problem: str, solver: str) -> str:
        """Return what the column ``code`` of a run by this code holds; empty for an unknown problem or solver."""
        known = self.solvers.get(solver), self.problems.get(problem)
        return codes.digest_run(known[0] or "", known[1] or "", self.running or self.measuring) if all(known) else ""


class CarriedCode(Shape, frozen=True):
    """The states of the code whose runs have equal bits: the newest, and the earlier ones with the oldest first."""

    now: Generation
    before: tuple[Generation, ...] = ()


def digest_present_code() -> Generation:
    """Return the digests of the installed code as a generation, without its commit."""
    here = codes.package_sources()
    judging = here.digest_modules(*JUDGING)
    return Generation(
        here.solvers, here.problems, here.measuring, judging, running=here.running, columns=here.columns.columns
    )


def read_carried(path: ConfinedPath | Path = FILE) -> CarriedCode | None:
    """Read ``carried.json``; return None if it does not exist, and raise FileError if it is invalid."""
    place = path if isinstance(path, ConfinedPath) else ConfinedPath(path.parent) / path.name
    if not place.is_there():
        return None
    return convert_shape(parse_json(read_text(place, "what was carried over"), place.name), CarriedCode, place.name)


@cache
def list_equal_generations() -> tuple[Generation, ...]:
    """Return the states of the code whose runs have the same bits as runs of the present code, the newest first.

    The present state comes first. It is the only one if ``carried.json`` is missing or was written for other code; the
    code that it was written for may have fewer columns.
    """
    here, carried = digest_present_code(), read_carried()
    if carried is None or not carried.now.has_equal_run_digests(here):
        return (here,)
    written = () if carried.now.columns == here.columns else (carried.now,)
    return (here, *written, *reversed(carried.before))


def is_current_or_carried(problem: str, solver: str, code: str) -> bool:
    """Return whether a run was made by the present code, or by an earlier state that was shown to give the same bits.

    ``code`` is that column of the run's record, the digest of its code; an empty one gives False.
    """
    return code != "" and any(code == g.digest_run_code(problem, solver) for g in list_equal_generations())


def is_measuring_carried(measured_by: str, known: Mapping[str, ColumnDigests] = MappingProxyType({})) -> bool:
    """Return whether a run was measured as by the present code, or by an earlier state shown to give the same bits.

    ``measured_by`` is that column of the run's record, a digest of code; True if it is empty, as in older records,
    whose column ``code`` covers it. ``known`` has the digests of series and columns for each digest of code, as stored
    in the run's folder: code that the present one agrees with in all of them measures the same.
    """
    if not measured_by:
        return True
    here, *others = (g.measured for g in list_equal_generations())
    if any(measured_by == state.digest for state in (here, *others)):
        return True
    if (then := known.get(measured_by)) is None:
        return False
    return not then.list_stale(here) or any(
        then.measuring == g.measuring and then.columns.items() <= g.columns.items() for g in others
    )


def bring_forward(code: CodeDigests) -> CodeDigests:
    """Return the digests that published verdicts record, with those of earlier code with equal bits made the present.

    They are returned unchanged if no known state of the code made these verdicts. The digest of judging is replaced
    only if all verdicts were shown to be equal, too.
    """
    here = digest_present_code()
    known = [g for g in list_equal_generations() if g.includes(code)]
    if not known:
        return code
    now = (
        {k: of.get(k, "") for k in own} for own, of in ((code.solvers, here.solvers), (code.problems, here.problems))
    )
    carried = read_carried()
    judges_alike = carried is not None and carried.now.judging == here.judging
    judging = here.judging if judges_alike and any(g.judging == code.judging for g in known) else code.judging
    return msgspec.structs.replace(
        code,
        solvers=next(now),
        problems=next(now),
        running=here.running,
        measuring=here.measuring,
        judging=judging,
        columns=here.columns,
    )


def add_generation(
    before: Generation,
    after: Generation,
    known: CarriedCode | None,
    solvers: Collection[str],
    problems: Collection[str],
) -> CarriedCode:
    """Return the content of ``carried.json`` after runs by ``before`` and ``after`` were found equal bit for bit.

    ``known`` is its present content; its earlier states stay if ``before`` equals its newest. ``solvers`` and
    ``problems`` are the names whose runs were all equal, the only ones that earlier states keep.
    """
    older = known.before if known is not None and known.now.has_equal_run_digests(before) else ()
    if known is not None and known.now.judging != before.judging:  # their verdicts were not compared
        older = tuple(msgspec.structs.replace(g, judging="") for g in older)
    return CarriedCode(after, tuple(_restrict_generation(g, solvers, problems) for g in (*older, before)))


def _restrict_generation(g: Generation, solvers: Collection[str], problems: Collection[str]) -> Generation:
    """Return the generation with the digests of these solvers and problems only."""
    own = {k: v for k, v in g.solvers.items() if k in solvers}
    return msgspec.structs.replace(g, solvers=own, problems={k: v for k, v in g.problems.items() if k in problems})
