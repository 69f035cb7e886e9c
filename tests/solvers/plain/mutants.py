"""``python -m mbsbench.tests.solvers.plain.mutants``: does the contract see every sign and factor of compiled steps?

Each mutant of ``mutating`` is planted in a forked process, in memory, and Python's interpreter runs the functions that
it changes in the cases of ``cases`` and the laws of ``laws``; one that differs from the plain method kills it.
Survivors have to be listed in ``survivors.toml`` with the reason. Exit code 1 where one is not, or where an entry there
has no survivor.
"""

import argparse
import ast
import contextlib
import gc
import hashlib
import json
import os
import re
import signal
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any, NamedTuple

import numpy as np

from mbsbench.harness.results.environment import ROOT
from mbsbench.solvers.formulations.compiled import algebra
from mbsbench.solvers.formulations.compiled.entries import InlineFunction, interpret_functions

from .cases import Case, make_cases
from .laws import Law
from .mutating import Mutant, list_mutants

SOLVERS = ROOT / "solvers" / "formulations"
RUNGE_KUTTA, RATTLE = ("rkmk_dopri5", "rkmk_dop853"), ("rattle", "lie_variational")
ALPHA, GC = ("generalized_alpha", "al_index3"), ("gc_weak_form", "gc_augmented_lagrangian")
FILES = {  # what is mutated, and the solvers whose cases, or the subjects whose laws, may see it
    "methods/energy_momentum.py": ("energy_momentum",),
    "methods/alpha.py": ALPHA,
    "methods/rattle.py": RATTLE,
    "methods/half_explicit.py": ("half_explicit",),
    "methods/gc_step.py": GC,
    "methods/gc_weak_form.py": GC,
    "methods/rkmk.py": RUNGE_KUTTA,
    "methods/iteration.py": (*RATTLE, *ALPHA, "energy_momentum"),
    "methods/products.py": (*RATTLE, *ALPHA, "half_explicit", "energy_momentum", "radau_ggl"),
    "methods/springs.py": ("radau_ggl",),
    "methods/radau.py": ("radau_ggl",),
    "methods/radau_error.py": ("radau_ggl",),
    "methods/free_body.py": RATTLE,
    "methods/gc_newton.py": GC,
    "compiled/evaluation.py": ("kernel",),
    "compiled/factor.py": ("kernel",),
    "compiled/block_lu.py": ("saddle",),
    "compiled/algebra.py": ("rotations", "kernel"),
}
LISTED = Path(__file__).with_name("survivors.toml")
KILLED, HUNG, SURVIVED, UNMET = "killed", "hung", "survived", "not met"
LEAST, TIMES = 0.5, 6.0  # [s] of processor time after which a case hangs, and of the time without a mutant
PACKAGE = "mbsbench.solvers.formulations"


class Baseline(NamedTuple):
    """A case without a mutant, interpreted: motion, processor time [s], the lines met by file, and how often any is."""

    case: Case | Law
    run: Any
    cost: float
    lines: dict[str, set[int]]
    steps: int


class Verdict(NamedTuple):
    """What became of a mutant: an outcome, and the message of the case that kills it, or how runs differ."""

    mutant: Mutant
    outcome: str
    words: str


def is_step(function: FunctionType) -> bool:
    """Return whether a function is one of a method's own."""
    return function.__module__.startswith(f"{PACKAGE}.methods.")


def solver_of(case: Case | Law) -> str:
    """Return the solver of a case, or the subject of a law: the first word of its name."""
    return case.name.split()[0].strip(",")


def run_all(cases: list[Case | Law], whole: bool) -> list[Baseline]:
    """Run all cases interpreted: the methods' own functions, or all compiled ones where ``whole``."""
    interpret_functions((lambda function: True) if whole else is_step)
    found = []
    for case in cases:
        lines, steps = dict[str, set[int]](), 0

        def trace(frame: FrameType, event: str, value: Any, lines: dict[str, set[int]] = lines) -> Any:
            name = frame.f_code.co_filename
            if not name.startswith(str(SOLVERS)):
                return None
            own = lines.setdefault(name, set())

            def follow(frame: FrameType, event: str, value: Any) -> Any:
                nonlocal steps
                steps += 1
                own.add(frame.f_lineno)
                return follow

            return follow

        sys.settrace(trace)
        case.compare(case.solve())
        sys.settrace(None)
        began = time.process_time()
        run = case.solve()
        found.append(Baseline(case, run, time.process_time() - began, lines, steps))
    return sorted(found, key=lambda one: one.steps)  # not by time: the same case kills a mutant on every machine


def plant(mutant: Mutant) -> None:
    """Change the function or table of a mutant in this process."""
    module = sys.modules[f"{PACKAGE}.{mutant.file.removesuffix('.py').replace('/', '.')}"]
    code = compile(ast.Module([mutant.tree], []), module.__file__ or "", "exec")
    if not mutant.function:
        exec(code, vars(module))
        source = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body
        after = [one for one in source if isinstance(one, ast.Assign) and one.lineno > mutant.line]
        exec(compile(ast.Module(after, []), "", "exec"), vars(module))  # tables that are made of it
        return
    target: Any = module
    for name in mutant.function.split("."):
        target = vars(target)[name]
    target = target.function if isinstance(target, InlineFunction) else getattr(target, "fget", target)
    name = mutant.function.split(".")[-1]
    target.__code__ = next(x for x in code.co_consts if isinstance(x, CodeType) and x.co_name == name)


def judge(mutant: Mutant, baselines: list[Baseline]) -> Verdict:
    """Plant a mutant in a process of its own, and run the cases that meet its line until one kills it."""
    path = str(SOLVERS / mutant.file)
    met = [b for b in baselines if (b.lines.get(path, set()) & set(mutant.lines) or not mutant.function)]
    met = [b for b in met if path in b.lines]
    if not met:
        return Verdict(mutant, UNMET, "no case runs this line")
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        outcome, words = KILLED, ""
        with contextlib.suppress(BaseException), open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            try:
                plant(mutant)
                outcome, words = run_cases(met, writing)
            except Exception as error:
                words = f"{type(error).__name__}: {error}"
            os.write(writing, json.dumps([outcome, words[:2000]]).encode() + b"\n")
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answers = [json.loads(line) for line in pipe]
    status = os.waitpid(child, 0)[1]
    if not answers or isinstance(answers[-1], str):
        how = "takes too long" if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGPROF else "crashes"
        return Verdict(mutant, HUNG, f"{answers[-1] if answers else 'no case'}: {how}")
    return Verdict(mutant, *answers[-1])


def run_cases(met: list[Baseline], writing: int) -> tuple[str, str]:
    """Run cases until one differs from the plain method; if none does, return how runs differ from those before.

    Before each its name is written to the pipe ``writing``, for one that never ends.
    """
    words = ""
    for base in met:
        os.write(writing, json.dumps(base.case.name).encode() + b"\n")
        signal.setitimer(signal.ITIMER_PROF, LEAST + TIMES * base.cost)
        with np.errstate(all="ignore"):
            try:
                run = base.case.solve()
            except Exception as error:
                return KILLED, f"{base.case.name}: {type(error).__name__}: {error}"
        try:
            base.case.compare(run)
        except AssertionError as error:
            return KILLED, str(error)
        words = words or base.case.describe_change(base.run, run)
    return SURVIVED, words or "the same bits"


def replace_loops() -> None:
    """Let copies and the like be NumPy's: they are most of the calls, and are themselves mutated elsewhere."""

    def copy(source, target):
        target[...] = source

    def clear(a):
        a[...] = 0.0

    def find_largest(a):
        return np.max(np.abs(a), initial=0.0)

    for function in (copy, clear, find_largest):
        getattr(algebra, function.__name__).function = function


def read_reasons() -> list[dict[str, str]]:
    """Return the entries of ``survivors.toml``."""
    return tomllib.loads(LISTED.read_text(encoding="utf-8"))["survivor"] if LISTED.exists() else []


def find_reason(m: Mutant, reasons: list[dict[str, str]]) -> dict[str, str] | None:
    """Return the entry for a survivor: of its file and function, with patterns of its change and its line."""
    for one in reasons:
        named = one["file"] == m.file and (m.function or "table") in one["function"].split()
        if named and re.search(one.get("change", ""), m.change) and re.search(one.get("line", ""), m.text):
            return one
    return None


def draw(mutants: list[Mutant], every: int, having: Sequence[str]) -> list[Mutant]:
    """Return one of ``every`` mutants with these words, drawn by a digest: the same ones until a line is changed."""
    some = [m for m in mutants if any(words in str(m) for words in having)]
    return [m for m in some if int(hashlib.sha256(str(m).encode()).hexdigest(), 16) % every == 0]


def judge_files(files: list[str], every: int, having: Sequence[str], say: Any) -> list[Verdict]:
    """Judge the mutants of files, in a process that has compiled nothing."""
    mutants = {file: draw(list_mutants(SOLVERS / file, file), every, having) for file in files}
    cases = make_cases({solver for file in files for solver in FILES[file]})
    for case in cases:  # as machine code, which is loaded, or compiled and kept
        case.compare(case.solve())
    if not isinstance(algebra.copy, InlineFunction):
        # numba's functions are in the modules now: what it has compiled is kept, for this process anew
        sys.stdout.flush()
        os.execv(sys.executable, sys.orig_argv)
    return [one for folder in ("methods/", "compiled/") for one in judge_folder(folder, mutants, cases, say)]


def judge_folder(folder: str, mutants: dict[str, list[Mutant]], cases: list[Case | Law], say: Any) -> list[Verdict]:
    """Judge the mutants of a folder's files: of the methods, or of what they call, where all is interpreted."""
    some = [m for file, own in mutants.items() if file.startswith(folder) for m in own]
    if not some:
        return []
    loops = [(f, f.function) for f in (algebra.copy, algebra.clear, algebra.find_largest)]
    if folder == "methods/":
        replace_loops()
    seen_by = {solver for m in some for solver in FILES[m.file]}
    baselines = run_all([case for case in cases if solver_of(case) in seen_by], folder != "methods/")
    gc.collect()
    gc.freeze()  # each run collects garbage: not that of the cases
    found = []
    for mutant in some:
        found.append(judge(mutant, [b for b in baselines if solver_of(b.case) in FILES[mutant.file]]))
        say(found[-1])
    for f, function in loops:
        f.function = function
    return found


def main() -> int:
    """Judge all mutants, or some; print those that survive, and a table by file."""
    parser = argparse.ArgumentParser("python -m mbsbench.tests.solvers.plain.mutants", description=__doc__)
    parser.add_argument("--only", nargs="*", default=[], metavar="WORD", help="files with one of these words")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one of N mutants")
    parser.add_argument("--having", nargs="*", default=[""], metavar="WORDS", help="mutants with one of these in print")
    parser.add_argument("--list", action="store_true", help="print the mutants, run nothing")
    parser.add_argument("--all", action="store_true", help="print the killed ones, too")
    given = parser.parse_args()
    files = [file for file in FILES if any(word in file for word in given.only) or not given.only]
    if not files:
        parser.error("no file has one of these words")
    if given.list:
        for file in files:
            print(*draw(list_mutants(SOLVERS / file, file), given.every, given.having), sep="\n")
        return 0
    reasons, used, unexplained = read_reasons(), list[dict[str, str] | None](), 0

    def say(verdict: Verdict) -> None:
        nonlocal unexplained
        lives = verdict.outcome in (SURVIVED, UNMET)
        if lives:
            used.append(find_reason(verdict.mutant, reasons))
            unexplained += used[-1] is None
        if given.all or (lives and used[-1] is None):
            print(f"{verdict.mutant}\n    {verdict.outcome}: {verdict.words}", flush=True)

    verdicts = judge_files(files, given.every, given.having, say)
    columns = (KILLED, HUNG, SURVIVED, UNMET)
    print(f"{'file':34}{'mutants':>9}" + "".join(f"{name:>9}" for name in columns))
    for file in files:
        outcomes = [v.outcome for v in verdicts if v.mutant.file == file]
        print(f"{file:34}{len(outcomes):9}" + "".join(f"{outcomes.count(name):9}" for name in columns))
    print(f"{len(verdicts)} mutants, {unexplained} without a reason; {sum(os.times()[:4]):.0f} s of processor time")
    idle = [
        one for one in reasons if given.every == 1 and given.having == [""] and one["file"] in files and one not in used
    ]
    for one in idle:
        print(f"no survivor for this entry: {one}")
    return int(unexplained > 0 or bool(idle))


if __name__ == "__main__":
    sys.exit(main())
