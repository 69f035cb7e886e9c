"""Run all judgements of results, write them to ``<results>/judgement/``, and compare them with the published ones."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from .certificates.orders import certify
from .certificates.symmetries import check_symmetries
from .certificates.work import collect_work
from .claims.count import judge
from .claims.maps import read_dimensions, select
from .claims.register import Register
from .currency import describe_changes
from .false_successes import find_false_successes

WHOLE = "referee"  # the suite that everything is judged on
# claims are tried on the runs of these suites; all are in ``referee``
SUITES = ("paper", "claims", "readings", "controls", "work")
OTHERS: tuple[tuple[str, Callable[[Path, Sequence[RunRecord]], Any]], ...] = (
    (files.ORDERS.name, certify),
    (files.DRIFTS.name, analyse_drift),
    (files.SYMMETRIES.name, check_symmetries),
    (files.WORK.name, collect_work),
)


@dataclass(frozen=True)
class VerdictChange:
    """A claim whose verdicts changed; a verdict is empty if the claim was not judged."""

    id: str
    before: str
    after: str


def judge_results(folder: Path, register: Register, watch: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Return every judgement on the results in ``folder`` by the name of its file, such as ``claims`` or ``drift``.

    Runs that a resumed folder holds twice count once. ``watch`` is called with the name of each judgement as it
    begins.
    """
    records = select_latest(store.load(folder, check_series=False).records)
    watch("claims")
    out: dict[str, Any] = {"claims": judge(register, list_tried(), records, lambda r: store.read_run_series(folder, r))}
    for name, function in OTHERS:
        watch(name)
        out[name] = function(folder, records)
    watch("wrong")
    out["wrong"] = find_false_successes(records, out.get(files.SYMMETRIES.name, ()))
    return out


def list_tried() -> tuple[RunSpec, ...]:
    """Return the runs of all suites that claims are tried on, each once."""
    return tuple({c.settings_id: c for name in SUITES for c in load_suite(name).specs}.values())


def select_needed(register: Register) -> tuple[RunSpec, ...]:
    """Return the runs that the maps of the register's claims select, without which verdicts cannot be judged."""
    places = [read_dimensions(s) for s in list_tried()]
    maps = {m.name: m for c in register.claims for m in (c.map, c.against, c.control) if m}.values()
    return tuple({p.spec.settings_id: p.spec for m in maps for p in select(places, m.over)}.values())


def list_published_runs() -> tuple[RunSpec, ...]:
    """Return the runs that verdicts are published from: those of the suite ``referee``."""
    return load_suite(WHOLE).specs


def find_missing(folder: Path, specs: Iterable[RunSpec]) -> list[RunSpec]:
    """Return those of the runs ``specs`` for which the results in ``folder`` hold no record."""
    held = {r.settings_id for r in store.load(folder, check_series=False).records}
    return [s for s in specs if s.settings_id not in held]


def write_judgements(folder: ConfinedPath, judged: dict[str, Any], code: CodeDigests) -> list[Path]:
    """Write a file per judgement atomically, and return the paths.

    ``judged`` is the result of ``judge_results``; claims are written with ``code``, the digests of the code they
    come from.
    """
    judged = {**judged, files.CLAIMS.name: files.add_code(judged[files.CLAIMS.name], code)}
    files_of = [folder / f"{name}.json" for name in judged]
    for file, found in zip(files_of, judged.values(), strict=True):
        file.write(format_judgement(found))
    return [file.path for file in files_of]


def describe_outdated(folder: ConfinedPath, now: CodeDigests) -> str:
    """Describe in one line what changed since the verdicts in ``folder`` were published; empty if nothing did.

    The line gives the commands that renew them. ``now`` are the digests of the present code.
    """
    return describe_changes(bring_forward(files.read_claims_code(folder)), now, WHOLE)


def find_changes(before: Sequence[JudgedClaim], after: Sequence[JudgedClaim]) -> list[VerdictChange]:
    """Return the claims whose verdicts differ, in the order of the register.

    Those that are no longer judged come last.
    """
    old, new = ({c.id: c.verdicts for c in claims} for claims in (before, after))
    out = [VerdictChange(k, old.get(k, ""), v) for k, v in new.items() if old.get(k, "") != v]
    return out + [VerdictChange(k, v, "") for k, v in old.items() if k not in new]
