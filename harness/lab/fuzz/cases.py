"""Write findings to disk: cases that the command repeats (JSON), mechanisms for other codes (MJCF), and a page."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import fill

import msgspec

from ...base.files import read_text, write_text
from ...mechanics.cut_trees.mjcf import write_mjcf
from ...mechanics.cut_trees.plain import flatten_tree
from ...mechanics.cut_trees.tree import build_spanning_tree
from ...mechanics.system import GROUND
from ...mechanics.types import Problem
from .log import NOT_ASKED, SUMMARY
from .mechanism import RandomMechanism
from .oracle import FLOOR, Behaviour, Oracle, OracleOutcome, OracleVerdict, Places
from .presenting import Form

WIDTH = 118
NONE = "No other route was asked, or none confirms it."


@dataclass(frozen=True)
class Case:
    """A mechanism and its form, the outcome of a code on them, the verdict of other routes, and the cause if known.

    ``ends`` has the positions of the bodies at the end, exact and by form; ``notes`` are those of the code's run, with
    its version.
    """

    outcome: OracleOutcome
    mechanism: RandomMechanism
    form: Form
    verdict: OracleVerdict | None = None
    evidence: str = ""
    options: dict[str, str] = field(default_factory=dict)
    floor: float = FLOOR
    cause: str = ""
    ends: dict[str, Places] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of its files, without extension."""
        return f"{self.outcome.solver}-{self.outcome.number}"

    @property
    def drawings(self) -> dict[str, Form]:
        """The forms in which the mechanism is written, by file name: as drawn and, if that is another, its own."""
        changed = {f"{self.name}-form.xml": self.form} if self.form != Form() else {}
        return {f"{self.name}.xml": Form(), **changed}

    @property
    def oracle(self) -> Oracle:
        """The oracle that examines the case again."""
        return Oracle(self.mechanism, self.form, self.floor)


def write_cases(folder: Path, cases: Sequence[Case]) -> None:
    """Write each case as JSON to ``folder``, and its mechanism as MJCF where its joints allow that.

    The cause that an existing file of the case names is kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for case in cases:
        path = folder / f"{case.name}.json"
        cause = read_case(path).cause if path.exists() else ""
        text = msgspec.json.format(msgspec.json.encode(replace(case, cause=cause)), indent=1).decode()
        write_text(path, text + "\n")
        for file, form in case.drawings.items():
            with suppress(ValueError):  # MJCF lacks some kinds of joints
                write_text(folder / file, format_mjcf(form.present_problem(case.oracle.problem)))


def write_page(folder: Path) -> None:
    """Write ``README.md`` from the summary and the cases in ``folder``."""
    write_text(folder / "README.md", format_page(folder))


def format_page(folder: Path) -> str:
    """Return the text of ``README.md``: counts in a sentence and a table, and a paragraph for each case."""
    summary = msgspec.json.decode(read_text(folder / SUMMARY, "summary"))
    of = summary["counts"]["all"]
    seeds = ", ".join(map(str, summary["seeds"]))
    who = f"{len(summary['counts']) - 1} codes on {summary['mechanisms']} mechanisms (seed {seeds})"
    verdicts = ", ".join(f"{of[v]} {v}" for v in (*OracleVerdict, NOT_ASKED))
    intro = (
        f"{of['trials']} trials of {who}: {of['deviations']} deviations, of which {verdicts}. A deviation is confirmed "
        "if two other routes agree on the true motion and the code is off it. Those shown are shrunk, and are "
        "answers of when they were found. `mbsbench fuzz SOLVERS --out FOLDER` continues the trials of a folder."
    )
    lines = ["# Findings of `mbsbench fuzz`", "", _fill(intro), "", *_format_table(summary["counts"])]
    cases = [read_case(p) for p in folder.glob("*.json") if p.name != SUMMARY]
    for case in sorted(cases, key=lambda c: (c.outcome.solver, c.outcome.number)):
        files = [f"`{name}` ({form})" for name, form in case.drawings.items() if (folder / name).exists()]
        file = f"MJCF, from keyframe `start`: {', '.join(files)}." if files else "Its joints have no MJCF."
        again = f"Repeat: `mbsbench fuzz {case.outcome.solver} --repeat {case.name}.json`. {file}"
        lines += ["", f"## {case.name}: {case.outcome.kind}", "", _describe_parts(case.mechanism)]
        for text in filter(
            None, (_describe_numbers(case), _describe_ends(case), case.evidence or NONE, case.cause, again)
        ):
            lines += ["", _fill(text)]
    return "\n".join(lines) + "\n"


def _fill(text: str) -> str:
    """Return the text in lines of at most ``WIDTH`` characters."""
    return fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def _describe_numbers(case: Case) -> str:
    """Return a sentence with the form, the steps and the deviations of a case."""
    o, m = case.outcome, case.mechanism
    where = f"Form: `{case.form}`, {m.steps} steps of {m.dt:g} s."
    if not o.limit:
        return f"{where} {o.words}"
    coarse, fine = o.deviation
    what = (
        "The answers differ" if o.kind is Behaviour.PRESENTATION else f"The answer (`{o.form}`) is off the true motion"
    )
    return (
        f"{where} {what} by {coarse:.3g} m, with half the step or the finer tolerance by {fine:.3g} m. The code's own "
        f"error, by that refinement, is {o.own:.2g} m."
    )


def _describe_ends(case: Case) -> str:
    """Return a sentence with the notes of the run and the positions of C of each body at the end [m]."""
    places = [f"{who} " + ", ".join(f"({x:.6g}, {y:.6g}, {z:.6g})" for x, y, z in at) for who, at in case.ends.items()]
    options = "".join(f", {name}={value}" for name, value in case.options.items())
    who = f"Run: {case.outcome.solver}{options}; {'; '.join(case.notes)}. " if case.notes else ""
    forms = dict.fromkeys(map(str, (Form(), case.form)))
    places += [f"{form}: it does not reach it" for form in forms if places and form not in case.ends]
    return who + (f"C of each body at the end [m]: {'; '.join(places)}." if places else "")


def read_case(path: Path) -> Case:
    """Read a case from its file; raise ValueError if it is unreadable or invalid."""
    try:
        return msgspec.json.decode(read_text(path, "case"), type=Case)
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path} is no case of fuzz: {error}") from None


def format_mjcf(problem: Problem) -> str:
    """Return the problem as MuJoCo's XML: a tree with cut joints, numbers with all digits, the start as a keyframe.

    Raise ValueError if it has joints other than hinges and balls.
    """
    system, start = problem.system, problem.initial
    if not system.is_pinned:
        raise ValueError("not written as MJCF: it has joints other than hinges and balls")
    tree = flatten_tree(build_spanning_tree(system, start), system, start)
    return write_mjcf(tree, problem.dt, lambda body: f"body {body + 1}", integrator="RK4")


def _format_table(counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return the counts by solver as the lines of a Markdown table, without columns of zeros."""
    names = [name for name, number in counts["all"].items() if number]
    rows = [f"| {solver} | {' | '.join(str(of.get(n, 0)) for n in names)} |" for solver, of in counts.items()]
    return [f"| | {' | '.join(names)} |", f"|---|{'---|' * len(names)}", *rows]


def _describe_parts(m: RandomMechanism) -> str:
    """Return bodies, joints and springs of a mechanism in words."""
    joints = ", ".join(f"{c.kind} {_name_end(c.i)}-{_name_end(c.j)}" for c in m.connections) or "no joints"
    return f"{len(m.bodies)} bodies; {joints}; {len(m.springs)} springs."


def _name_end(body: int) -> str:
    """Return a body of a joint in words: ``ground``, or its number from 1."""
    return "ground" if body == GROUND else str(body + 1)
