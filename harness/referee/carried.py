"""Published results carried over: later code that gives the same numbers, bit for bit, as runs by both have shown.

A digest changes with every name in the code. What is published stays true of code whose runs have the same bits:
``docs/carry_over.py`` makes suite ``ci`` and a hundred runs of suite ``referee`` by an earlier commit and by the
present code, judges both, and notes in ``results/published/carried.json`` the digests of both, of solvers whose runs
are all equal; those of judging where all verdicts and counts are.
"""

from collections.abc import Collection
from functools import cache
from pathlib import Path

import msgspec

from ..files import parse_json, read_text
from ..places import Place
from ..results import codes
from ..results.judgements.claims import Code
from ..results.judgements.files import PUBLISHED
from ..shapes import Shape, convert_shape
from .currency import JUDGING

FILE = PUBLISHED / "carried.json"


class Generation(Shape, frozen=True):
    """The digests of one state of the code."""

    solvers: dict[str, str]
    problems: dict[str, str]
    measuring: str
    judging: str = ""
    commit: str = ""
    shown: str = ""  # the runs that had equal bits then and at the generation after it

    def makes_same_runs(self, other: "Generation") -> bool:
        """Whether all digests are equal that runs come from; judging them is another matter."""
        return all(getattr(self, k) == getattr(other, k) for k in ("solvers", "problems", "measuring"))

    def includes(self, code: Code) -> bool:
        """Whether published verdicts are of this code."""
        parts = ((code.solvers, self.solvers), (code.problems, self.problems))
        return code.measuring == self.measuring and all(own.items() <= known.items() for own, known in parts)

    def code_of(self, problem: str, solver: str) -> str:
        """Return the digest that a run of that time has as its column ``code``."""
        known = self.solvers.get(solver), self.problems.get(problem)
        return codes.digest_run(known[0] or "", known[1] or "", self.measuring) if all(known) else ""


class Carried(Shape, frozen=True):
    """States of the code whose runs have equal bits: the newest, and those before it, the oldest first."""

    now: Generation
    before: tuple[Generation, ...] = ()


def present() -> Generation:
    """Return the digests of the code that is here."""
    here = codes.package_sources()
    return Generation(here.solvers, here.problems, here.measuring, here.of(*JUDGING))


def read_carried(path: Place | Path = FILE) -> Carried | None:
    """Read the file, or None where there is none; FileError where it is not as it should be."""
    place = path if isinstance(path, Place) else Place(path.parent) / path.name
    if not place.is_there():
        return None
    return convert_shape(parse_json(read_text(place, "what was carried over"), place.name), Carried, place.name)


@cache
def list_equal() -> tuple[Generation, ...]:
    """List the states of the code whose runs have the bits of the present one, which comes first."""
    here, carried = present(), read_carried()
    if carried is None or not carried.now.makes_same_runs(here):
        return (here,)
    return (here, *reversed(carried.before))


def is_of_this_code(problem: str, solver: str, code: str) -> bool:
    """Whether a run with the digest ``code`` was made by this code, or by one with the same bits."""
    return any(code == g.code_of(problem, solver) for g in list_equal())


def bring_forward(code: Code) -> Code:
    """The digests of published verdicts, those of equal bits in the words of the present code."""
    here = present()
    known = [g for g in list_equal() if g.includes(code)]
    if not known:
        return code
    now = ({k: of.get(k, "") for k in own} for own, of in
           ((code.solvers, here.solvers), (code.problems, here.problems)))  # fmt: skip
    carried = read_carried()
    judges_alike = carried is not None and carried.now.judging == here.judging
    judging = here.judging if judges_alike and any(g.judging == code.judging for g in known) else code.judging
    return msgspec.structs.replace(
        code, solvers=next(now), problems=next(now), measuring=here.measuring, judging=judging
    )


def carry(
    before: Generation, after: Generation, known: Carried | None, solvers: Collection[str], problems: Collection[str]
) -> Carried:
    """Add a generation: what was equal to ``before`` is equal to ``after``, of these solvers and problems."""
    older = known.before if known is not None and known.now.makes_same_runs(before) else ()
    if known is not None and known.now.judging != before.judging:  # nobody compared their verdicts
        older = tuple(msgspec.structs.replace(g, judging="") for g in older)
    return Carried(after, tuple(_restrict(g, solvers, problems) for g in (*older, before)))


def _restrict(g: Generation, solvers: Collection[str], problems: Collection[str]) -> Generation:
    own = {k: v for k, v in g.solvers.items() if k in solvers}
    return msgspec.structs.replace(g, solvers=own, problems={k: v for k, v in g.problems.items() if k in problems})
