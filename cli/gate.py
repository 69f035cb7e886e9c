"""Run a short suite and compare it with the committed thresholds (``gate``)."""

import argparse
import contextlib
import dataclasses
import difflib
import math
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.text import Text

from ..harness.base.files import write_text
from ..harness.catalogue import codes
from ..harness.catalogue.suites.spec import RunSpec
from ..harness.catalogue.suites.suite import Suite, load_suite
from ..harness.judge.gate.baseline import FOLDER, format_thresholds, parse_thresholds, read_thresholds
from ..harness.judge.gate.check import (
    STATES,
    WORST,
    describe_contradiction,
    describe_counts,
    describe_gate,
    find_worst_verdict,
    is_open,
    judge_runs,
    list_missing_packages,
    select_consequences,
    select_judged,
    select_notable,
    tighten_bounds,
)
from ..harness.judge.gate.files import (
    JUNIT_BEGUN,
    MARKDOWN_BEGUN,
    format_annotations,
    format_junit,
    format_markdown,
    make_json_object,
)
from ..harness.judge.gate.rounding import choose_kernels, list_core_types, repeat_run
from ..harness.judge.gate.spread import find_unstable, widen_by_spread
from ..harness.judge.gate.thresholds import propose_bounds
from ..harness.results import store
from ..harness.results.column_digests import find_stale_columns, read_stored_digests
from ..harness.results.findings import Finding, Verdict
from ..harness.results.history import GATES, make_rows, write_rows
from ..harness.results.provenance import read_environment
from ..harness.results.records import RunRecord
from ..harness.results.reproduce import REFEREED
from ..harness.run.runner import Request, choose_pool, name_new_folder
from .arguments import UsageError, check_not_installed, count_jobs, find_results, load_plugins
from .findings import STYLE, print_findings
from .keeping import make_series_choice
from .progress import run_watched, warn_of_deviating_bits
from .terminal import make_console, make_error_console, plural, print_json

COMMENT = re.compile(r"^[^\"'#]*((\"([^\"\\\n]|\\.)*\"|'[^'\n]*')[^\"'#\n]*)*#", re.MULTILINE)  # not in a string
REMEDY = (
    "mend what moved, or, where a number should have moved, add --update: it prints tighter and new bounds as a diff, "
    "with --loosen wider ones, too"
)


def run(arguments: argparse.Namespace) -> int:
    """Run the suite, or read --results, and compare it with the thresholds; return 1 if the gate is closed, else 0.

    The findings are printed, written to the JUnit and Markdown files that are asked for, and added to the history of
    gates. With --update nothing is judged: new thresholds are printed or written. Then return 0, or 2 if with --spread
    rounding decides the status of a run.
    """
    _check_call(arguments)
    for file, words in ((arguments.junit, JUNIT_BEGUN), (arguments.markdown, MARKDOWN_BEGUN)):
        if file:
            write_text(file, words)  # before plugins are loaded: an interrupted gate leaves no verdict
    suite = _make_file_suite(arguments) or load_suite(arguments.suite or "ci", load_plugins(arguments.plugin))
    path = Path(arguments.thresholds) if arguments.thresholds else FOLDER / f"{suite.name}.toml"
    if arguments.spread is not None and (arguments.spread < 1 or arguments.loosen or suite.name == REFEREED):
        raise UsageError("--spread takes a number of repeats > 0, needs runs of a suite, and excludes --loosen")
    if arguments.update:
        check_not_installed(path, "--thresholds FILE")
    thresholds = read_thresholds(path, suite.name, is_new=arguments.update and not path.exists())
    if not arguments.results or arguments.spread:
        warn_of_deviating_bits()
    name, stamp, records = _run_or_read_results(arguments, suite)
    of_files = suite.name == REFEREED  # whose results are no result of this code: the newest file counts
    code = None if arguments.any_code or of_files else partial(codes.digest_run_code, plugins=suite.plugins)
    judged = select_judged(records, code)
    specs: Sequence[RunSpec | RunRecord] = judged if of_files else suite.specs
    if arguments.update:
        if arguments.write and not judged:
            raise UsageError(f"no result of this code to take thresholds of {suite.name!r} from; nothing was written")
        if arguments.spread:
            samples = _repeat_runs(arguments, suite, judged)
            _propose_thresholds(path, format_thresholds(widen_by_spread(thresholds, samples)), write=arguments.write)
            unstable = find_unstable(samples)
            for case, words in unstable.items():
                make_error_console().print(f"error: {case}: rounding decides the status: {words}; its bounds stay")
            return 2 if unstable else 0
        new = tighten_bounds(thresholds, judged, propose_bounds(judged), loosen=arguments.loosen)
        return _propose_thresholds(path, format_thresholds(new), write=arguments.write)
    found = judge_runs(specs, records, thresholds, code, arguments.without)
    if arguments.json:
        print_json(make_json_object(found, suite.name))
    else:
        _print_findings(found, everything=arguments.all)
        if not is_open(found):
            make_error_console().print(REMEDY, soft_wrap=True, highlight=False)
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for line in format_annotations(found, suite.name):
            make_error_console().print(line)
    for file, made in ((arguments.junit, format_junit), (arguments.markdown, format_markdown)):
        if file:
            write_text(file, made(found, suite.name))
    worst = {f.subject: STATES[f.verdict] for f in reversed(found)}  # the worst come first
    with contextlib.suppress(OSError):  # a folder that cannot be written only costs the history
        write_rows(store.LOCAL / GATES / f"{name}.jsonl", make_rows(name, stamp, judged, worst))
    return 0 if is_open(found) else 1


def _check_call(arguments: argparse.Namespace) -> None:
    """Raise UsageError for options that cannot be combined; set ``arguments.results`` to the path of its folder."""
    arguments.results = arguments.results and find_results(arguments.results)
    if arguments.any_code and not arguments.results:
        raise UsageError("--any-code needs --results; a suite that is run now is of this code")
    for name in ("junit", "markdown", "json", "loosen", "write", "spread"):
        needs = name in ("loosen", "write", "spread")
        if getattr(arguments, name) not in (None, False) and arguments.update is not needs:
            raise UsageError(f"--{name} {'needs' if needs else 'cannot be combined with'} --update")
    if arguments.without and arguments.update:
        raise UsageError("--without cannot be combined with --update, which leaves unmeasured runs as they are")


def _make_file_suite(arguments: argparse.Namespace) -> Suite | None:
    """Return a suite without runs if --results names a folder of files judged by ``referee``, and no --suite is given.

    Return None for any other call.
    """
    if arguments.results is None or arguments.suite is not None:
        return None
    records = _load_records(arguments.results)
    if not records or any(r.label != REFEREED for r in records):
        return None
    return Suite(REFEREED, "motions from files", (), "")


def _load_records(results: Path) -> tuple[RunRecord, ...]:
    """Return the records of a results folder; raise UsageError if one is damaged or contradicts itself.

    A damaged file might be a run's newest result, so that older ones must not be judged in its place.
    """
    loaded = store.load(results)
    if loaded.unreadable:
        n, (first, why) = len(loaded.unreadable), next(iter(loaded.unreadable.items()))
        raise UsageError(f"{n} file{'s' * (n > 1)} cannot be judged: {first}: {why}; run it again, or remove it")
    if doubts := [f"{r.case}: {words}" for r in loaded.records if (words := describe_contradiction(r))]:
        raise UsageError(f"{plural(len(doubts), 'record')} cannot be judged: {doubts[0]}; run it again, or remove it")
    return loaded.records


def _clear_stale_codes(folder: Path, records: Sequence[RunRecord]) -> tuple[RunRecord, ...]:
    """Return the records, with an empty digest of the code where the present code measures a column differently.

    A record with an empty digest is not judged as a result of this code.
    """
    known, here = read_stored_digests(folder), codes.read_column_digests()
    return tuple(dataclasses.replace(r, code="") if find_stale_columns(r, known, here) else r for r in records)


def _run_or_read_results(
    arguments: argparse.Namespace, suite: Suite
) -> tuple[str, Mapping[str, Any], tuple[RunRecord, ...]]:
    """Run the suite, unless --results names a folder; return the folder's name, its stamp and its records."""
    if arguments.results:
        folder = arguments.results
        records = _load_records(folder)
        return folder.resolve().name, read_environment(folder), _clear_stale_codes(folder, records)
    with tempfile.TemporaryDirectory() as place:
        name = name_new_folder(suite.name).name
        folder = Path(arguments.out) if arguments.out else Path(place) / name
        request = Request(suite, folder, count_jobs(arguments.jobs), choose_rows=make_series_choice(suite))
        loaded, _ = run_watched(request, quiet=arguments.json)
        return name, read_environment(folder), loaded.records


def _print_findings(found: Sequence[Finding], *, everything: bool) -> None:
    """Print findings, the worst last, where a log of CI is read first; consequences are only counted.

    ``everything`` also prints findings that passed unmoved, and the consequences: bounds that failed only because their
    run did not end as expected.
    """
    implied = [] if everything else select_consequences(found)
    shown = [f for f in (found if everything else select_notable(found)) if f not in implied]
    print_findings(map(_describe_change, sorted(shown, key=lambda f: WORST.index(f.verdict), reverse=True)))
    if implied:
        words = f"{plural(len(implied), 'bound')} more of runs that did not end as expected"
        make_console().print(f"{words} failed with them (--all shows them)")
    if more := sum(f.verdict is Verdict.MET and f not in shown for f in found):
        make_console().print(f"{more} more pass and have moved by less than 1 % (--all shows them)")
    gate, counts = describe_gate(found), describe_counts(found)
    words = f"{gate} ({counts})" if list_missing_packages(found) else f"{gate}: {counts}"
    make_console().print(Text(f"gate {words}", STYLE[find_worst_verdict(found)]), soft_wrap=True)


def _describe_change(f: Finding) -> Finding:
    """Return the finding with words on its change from the baseline and, if it did not pass, on the bound's reason."""
    value, was = f.value, f.before
    change = "missing" if math.isnan(value) else f"x {value / was:.3g}" if was else f"{value - was:+.3g}"
    words = [] if math.isnan(was) else [f"was {was:.3g} ({change})"]
    words += [f.why] if f.verdict is not Verdict.MET else []
    return dataclasses.replace(f, words="; ".join(words))


def _repeat_runs(
    arguments: argparse.Namespace, suite: Suite, judged: Sequence[RunRecord]
) -> dict[str, list[tuple[str, RunRecord]]]:
    """Repeat the suite's runs with perturbed starts and other arithmetic; return by case the pairs of kind and record.

    The kind says what was changed; it is empty for the unperturbed runs ``judged``, which come first. Runs for each
    type of core are made separately. Repeats with the same settings, such as other kernels with an unperturbed start,
    are one sample.
    """
    known = {r.settings_id: r for r in judged}
    repeats: dict[str, dict[str, tuple[str, str, RunSpec]]] = {}  # by core type and settings
    samples: dict[str, list[tuple[str, RunRecord]]] = {}
    for spec in suite.specs:
        if spec.settings_id in known:
            samples[spec.case] = [("", known[spec.settings_id])]
            for kind, changed, core in repeat_run(spec, arguments.spread, list_core_types()):
                repeats.setdefault(core, {}).setdefault(changed.settings_id, (spec.case, kind, changed))
    for core, own in repeats.items():
        extra = dataclasses.replace(suite, specs=tuple(changed for _, _, changed in own.values()), total_limit=None)
        pool = choose_pool(environ=choose_kernels(core))
        with tempfile.TemporaryDirectory() as place:
            request = Request(extra, Path(place) / "spread", count_jobs(arguments.jobs), pool=pool)
            loaded, _ = run_watched(request, quiet=False)
        repeated = {r.settings_id: r for r in loaded.records}
        for settings_id, (case, kind, _) in own.items():
            samples[case].append((kind, repeated[settings_id]))
    return samples


def _propose_thresholds(path: Path, new: str, *, write: bool) -> int:
    """Print the text ``new`` of the proposed thresholds as a diff, or ``write`` it to ``path``; return 0.

    A note says so if comments of the file are lost by writing it.
    """
    parse_thresholds(new, path)  # checked first, so that the gate can read what is written
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    out = make_console()
    if write:
        write_text(path, new)
        out.print(f"written: {path}")
        if COMMENT.search("\n".join(line for line in before.splitlines() if line not in new.splitlines())):
            out.print("its comments were removed: restore them from the previous version, or move them into `reason`")
        return 0
    for line in difflib.unified_diff(before.splitlines(), new.splitlines(), str(path), "proposed", lineterm=""):
        out.print(line)
    return 0
