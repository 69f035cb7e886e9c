"""Keep every trial of a campaign on disk, a line of JSON each, so that it can be interrupted, continued and counted."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from ...base.files import FileError, read_text, write_text
from ...catalogue import registry
from ...catalogue.codes import package_sources
from .campaign import CampaignSettings, Pair, run_apart, run_campaign
from .oracle import FINDINGS, SHOWN, Behaviour, OracleOutcome, OracleVerdict, describe_outcome

NAME, SUMMARY = "trials.jsonl", "summary.json"
CPU = 180.0  # [s] for the second route: the reference of a difficult mechanism takes a minute


@dataclass(frozen=True)
class Trial:
    """An outcome with its settings, code and, for a deviation, the verdict of the second route and its evidence."""

    settings: CampaignSettings
    code: str  # digest of the solver; "" for plugins
    outcome: OracleOutcome
    verdict: OracleVerdict | None = None
    evidence: str = ""

    @property
    def key(self) -> tuple[str, int, str]:
        """The settings, mechanism and solver of the trial; a later line of the log with the same key replaces it.

        The code of the solver is not part of it.
        """
        return str(self.settings), self.outcome.number, self.outcome.solver

    @property
    def is_deviation(self) -> bool:
        """True if the outcome is a deviation, which the second route must confirm."""
        return self.outcome.kind in FINDINGS


def digest_solver(solver: str) -> str:
    """Return the digest of the code of a solver of the package; empty for one of a plugin."""
    return package_sources().solvers.get(solver, "")


def read_trials(folder: Path) -> list[Trial]:
    """Read all trials in ``folder``, each from its last line, and remove an incomplete line at the end of the file.

    Raise FileError for a line that is not a trial.
    """
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
    """Add a trial to the log in ``folder``, as a line of JSON."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / NAME).open("ab") as file:
        file.write(msgspec.json.encode(trial) + b"\n")


def list_untried_pairs(folder: Path, settings: CampaignSettings, pairs: Sequence[Pair]) -> list[Pair]:
    """Return those of ``pairs`` that have no trial with these settings and the present code in ``folder``."""
    done = {trial.key for trial in read_trials(folder) if trial.code == digest_solver(trial.outcome.solver)}
    sound = ((pair, OracleOutcome(pair[1], Behaviour.SOUND, number=pair[0])) for pair in pairs)
    return [pair for pair, outcome in sound if Trial(settings, "", outcome).key not in done]


def run_trials(
    folder: Path, settings: CampaignSettings, pairs: Sequence[Pair], jobs: int, report_line: Callable[[str], None]
) -> None:
    """Run the pairs, add each trial to the log in ``folder``, and judge deviations by other routes.

    ``report_line`` is called with a line on each outcome that a reader should see at once (``SHOWN``).
    """
    for outcome in run_campaign(settings, pairs, jobs):
        append_trial(folder, Trial(settings, digest_solver(outcome.solver), outcome))
        if outcome.kind in SHOWN:
            report_line(describe_outcome(outcome))
    for trial in read_trials(folder):
        if trial.is_deviation and trial.verdict is None:
            append_trial(folder, ask_second_route(trial))


def ask_second_route(trial: Trial) -> Trial:
    """Judge the deviation of a trial by other routes in a separate process; return the trial with its verdict.

    The verdict is undecidable if the process ends without one, after ``CPU`` [s] at most.
    """

    def decide() -> str:
        """Let the oracle decide, and return verdict and evidence as JSON."""
        found, settings = trial.outcome, trial.settings
        oracle = settings.make_oracle(found.number)
        return json.dumps(oracle.decide(found.solver, registry.make_solver(found.solver, settings.options)))

    sent = run_apart(decide, CPU)
    verdict, evidence = json.loads(sent) if sent else (OracleVerdict.UNDECIDABLE, "the second route did not answer")
    return replace(trial, verdict=OracleVerdict(verdict), evidence=evidence)


def count_trials(trials: Iterable[Trial]) -> dict[str, dict[str, int]]:
    """Return counts of trials for each solver, and their sums for ``all``.

    Trials are counted by behaviour and, if they are deviations, by verdict.
    """
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
CONFIRMED = str(OracleVerdict.CONFIRMED)  # name of their column
COLUMNS = ("trials", *map(str, Behaviour), "deviations", *map(str, OracleVerdict), NOT_ASKED)


def write_summary(folder: Path, trials: Iterable[Trial]) -> Mapping[str, Mapping[str, int]]:
    """Write ``summary.json`` of all trials to ``folder``, and return its counts by solver."""
    trials = list(trials)
    counts = count_trials(trials)
    text = {
        "mechanisms": len({(t.settings.seed, t.outcome.number) for t in trials}),
        "seeds": sorted({t.settings.seed for t in trials}),
        "counts": counts,
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / SUMMARY, json.dumps(text, indent=1) + "\n")
    return counts
