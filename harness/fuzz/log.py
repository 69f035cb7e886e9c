"""Every trial of a campaign on disk, a line of JSON each: a campaign can be interrupted, continued and counted."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..files import FileError, read_text, write_text
from ..results.codes import package_sources
from ..sandbox.apart import Apart
from .campaign import MEMORY, Settings
from .oracle import FINDINGS, Kind, Outcome, Verdict

NAME, SUMMARY = "trials.jsonl", "summary.json"
CPU = 180.0  # [s] for the second route: a reference of an unlucky mechanism takes a minute


@dataclass(frozen=True)
class Trial:
    """An outcome, the settings and the code it is of, and of a deviation what the second route says."""

    settings: Settings
    code: str  # digest of the solver; "" for plugins
    outcome: Outcome
    verdict: Verdict | None = None
    evidence: str = ""

    @property
    def key(self) -> tuple[str, int, str]:
        """What it is a trial of, by whatever code; a later line with the same key replaces it."""
        return str(self.settings), self.outcome.number, self.outcome.solver

    @property
    def is_deviation(self) -> bool:
        """Whether the second route is to be asked."""
        return self.outcome.kind in FINDINGS


def code_of(solver: str) -> str:
    """The digest of a solver's modules."""
    return package_sources().solvers.get(solver, "")


def read_trials(folder: Path) -> list[Trial]:
    """All trials in ``folder``, each as its last line says; a last line that was cut off is taken away."""
    path, trials = folder / NAME, {}
    text = read_text(path, "trials") if path.exists() else ""
    if text and not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
        write_text(path, text)
    for number, line in enumerate(text.splitlines(), 1):
        try:
            trial = msgspec.json.decode(line, type=Trial)
        except msgspec.MsgspecError as error:
            raise FileError(f"{path}, line {number}: no trial: {error}") from None
        trials[trial.key] = trial
    return list(trials.values())


def append_trial(folder: Path, trial: Trial) -> None:
    """Add a line."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / NAME).open("ab") as file:
        file.write(msgspec.json.encode(trial) + b"\n")


def ask_second_route(trial: Trial) -> Trial:
    """``trial`` of a deviation with its verdict, found in a process of its own."""

    def target(send: Callable[[str], None]) -> None:
        found, settings = trial.outcome, trial.settings
        oracle = settings.oracle(found.number)
        send(json.dumps(oracle.decide(found.solver, registry.make_solver(found.solver, settings.options))))

    sent = Apart(target, limit=CPU, memory=MEMORY, code=CODE_LIMIT).wait().sent
    verdict, evidence = json.loads(sent) if sent else (Verdict.UNDECIDABLE, "the second route did not answer")
    return replace(trial, verdict=Verdict(verdict), evidence=evidence)


def count_trials(trials: Iterable[Trial]) -> dict[str, dict[str, int]]:
    """By solver: trials, those of each kind, deviations, and these by verdict; ``all`` are sums."""
    counts: dict[str, dict[str, int]] = {}
    for trial in trials:
        names = ["trials", str(trial.outcome.kind)]
        names += ["deviations", str(trial.verdict or NOT_ASKED)] if trial.is_deviation else []
        for solver in (trial.outcome.solver, "all"):
            of = counts.setdefault(solver, dict.fromkeys(COLUMNS, 0))
            for name in names:
                of[name] = of.get(name, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (item[0] == "all", item[0])))


NOT_ASKED = "not asked"
COLUMNS = ("trials", *map(str, Kind), "deviations", *map(str, Verdict), NOT_ASKED)


def write_summary(folder: Path, trials: Iterable[Trial]) -> Mapping[str, Mapping[str, int]]:
    """Write ``summary.json`` and return its counts."""
    trials = list(trials)
    counts = count_trials(trials)
    text = {"mechanisms": len({(t.settings.seed, t.outcome.number) for t in trials}),
            "seeds": sorted({t.settings.seed for t in trials}), "counts": counts}  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / SUMMARY, json.dumps(text, indent=1) + "\n")
    return counts
