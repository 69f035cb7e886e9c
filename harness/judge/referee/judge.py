"""Run all judgements of results, write them to ``<results>/judgement/``, and compare them with the published ones."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from ...base.confined_paths import ConfinedPath
from ...catalogue.suites.spec import RunSpec
from ...catalogue.suites.suite import load_suite
from ...results import store
from ...results.judgements import files
from ...results.judgements.claims import CodeDigests, JudgedClaim
from ...results.judgements.files import format_judgement
from ...results.provisional import select_latest
from ...results.records import RunRecord
from .carried import bring_forward
from .certificates.drift import analyse_drift
from .certificates.orders import certify_orders
from .certificates.symmetries import check_symmetries
from .certificates.work import collect_work
from .claims.frame import SeriesOf, read_dimensions, select_runs
from .claims.judging import judge_claims
from .currency import describe_changes, digest_code_and_claims
from .false_successes import find_false_successes
from .registers import PAPER, PLACES, RegisterPlace

OTHERS: tuple[tuple[str, Callable[[Path, Sequence[RunRecord]], Any]], ...] = (
    (files.ORDERS.name, certify_orders),
    (files.DRIFTS.name, analyse_drift),
    (files.SYMMETRIES.name, check_symmetries),
    (files.WORK.name, collect_work),
)


def judge_results(
    folder: Path, places: Sequence[RegisterPlace] = PLACES, watch: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Return every judgement on the results in ``folder`` by the name of its file, such as ``claims`` or ``drift``.

    ``places`` are the registers of claims. Runs that a resumed folder holds twice count once. ``watch`` is called as
    each judgement begins, with its name in words.
    """
    records = select_latest(store.load(folder, check_series=False).records)
    out: dict[str, Any] = {}
    for place in places:
        watch(f"claims {place.whose}")
        out[place.file.name] = judge_register(place, records, lambda r: store.read_run_series(folder, r))
    for name, function in OTHERS:
        watch("observed orders" if name == files.ORDERS.name else name)
        out[name] = function(folder, records)
    watch("false successes")
    out["wrong"] = find_false_successes(records, out.get(files.SYMMETRIES.name, ()))
    return out


def judge_register(place: RegisterPlace, records: Iterable[RunRecord], series_of: SeriesOf) -> tuple[JudgedClaim, ...]:
    """Return the verdicts on the claims of a register, tried on the runs of its suites."""
    found = judge_claims(place.read(), list_tried_runs(place), records, series_of)
    return tuple(replace(c, register=place.name) for c in found)


def list_tried_runs(place: RegisterPlace = PAPER) -> tuple[RunSpec, ...]:
    """Return the runs of all suites that the claims of a register are tried on, each once."""
    return tuple({c.settings_id: c for name in place.suites for c in load_suite(name).specs}.values())


def select_needed_runs(place: RegisterPlace) -> tuple[RunSpec, ...]:
    """Return the runs that the maps of the register's claims select, each once: verdicts need all of them."""
    tried = [read_dimensions(s) for s in list_tried_runs(place)]
    maps = {m.name: m for c in place.read().claims for m in c.maps if m}.values()
    return tuple({p.spec.settings_id: p.spec for m in maps for p in select_runs(tried, m.over)}.values())


def list_published_runs(place: RegisterPlace = PAPER) -> tuple[RunSpec, ...]:
    """Return the runs from which the verdicts of a register are published.

    For the paper they are its whole suite, ``referee``, which orders, symmetries and more are published from, too; for
    the field they are the runs of its claims' maps.
    """
    return load_suite(place.whole).specs if place.name == PAPER.name else select_needed_runs(place)


def digest_code(place: RegisterPlace = PAPER) -> CodeDigests:
    """Return the digests of the present code that verdicts on the claims of a register would record."""
    return digest_code_and_claims(place.read(), list_published_runs(place))


def find_missing(records: Iterable[RunRecord], specs: Iterable[RunSpec]) -> list[RunSpec]:
    """Return those of the runs ``specs`` for which there is no record among ``records``."""
    held = {r.settings_id for r in records}
    return [s for s in specs if s.settings_id not in held]


def write_judgements(folder: ConfinedPath, judged: Mapping[str, Any], codes: Mapping[str, CodeDigests]) -> list[Path]:
    """Write a JSON file per judgement to ``folder``, each atomically, and return the paths.

    ``judged`` is the result of ``judge_results``, or a part of it. ``codes`` has, by the name of each file of claims
    in it, the digests of the code that judged them, which are written with the claims.
    """
    out = []
    for name, found in judged.items():
        file = folder / f"{name}.json"
        file.write(format_judgement(files.add_code(found, codes[name]) if name in codes else found))
        out.append(file.path)
    return out


def describe_outdated(folder: ConfinedPath, place: RegisterPlace = PAPER, now: CodeDigests | None = None) -> str:
    """Describe in one line what changed since the verdicts in ``folder`` were published; empty if nothing did.

    The line gives the commands that renew them. ``now`` are the digests of the present code, computed if not given.
    """
    published = bring_forward(files.read_claims_code(folder, place.file))
    return describe_changes(published, now or digest_code(place), place.whole)


def find_changes(before: Sequence[JudgedClaim], after: Sequence[JudgedClaim]) -> list[tuple[str, str, str]]:
    """Return the claims whose verdicts differ: id, verdicts before and verdicts after, in the order of the register.

    Claims that are no longer judged come last; verdicts are empty where a claim was not judged.
    """
    old, new = ({c.id: c.verdicts for c in claims} for claims in (before, after))
    out = [(k, old.get(k, ""), v) for k, v in new.items() if old.get(k, "") != v]
    return out + [(k, v, "") for k, v in old.items() if k not in new]
