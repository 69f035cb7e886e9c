"""All judgements of results, written to ``<results>/judgement/``, and what changed against the published ones."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..places import Place
from ..results import store
from ..results.judgements import files
from ..results.judgements.claims import Claim, Code
from ..results.judgements.files import format_judgement
from ..results.provisional import latest_of_each
from ..results.records import RunRecord
from ..suites.spec import RunSpec
from ..suites.suite import load_suite
from .carried import bring_forward
from .certificates.drift import analyse_drift
from .certificates.orders import certify
from .certificates.symmetries import check_symmetries
from .certificates.work import collect_work
from .claims.count import judge
from .claims.maps import place, select
from .claims.register import Register
from .currency import describe_changes
from .false_successes import find_false_successes

WHOLE = "referee"  # the suite that everything is judged on
SUITES = ("paper", "claims", "readings", "controls", "work")  # claims are tried on their runs; all are in ``referee``
OTHERS: tuple[tuple[str, Callable[[Path, Sequence[RunRecord]], Any]], ...] = (
    (files.ORDERS.name, certify), (files.DRIFTS.name, analyse_drift), (files.SYMMETRIES.name, check_symmetries),
    (files.WORK.name, collect_work),
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """A claim with other verdicts than before; empty where it was not judged."""

    id: str
    before: str
    after: str


def judge_results(folder: Path, register: Register, watch: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Every judgement by the name of its file; runs that a resumed folder holds twice count once."""
    records = latest_of_each(store.load(folder, check_series=False).records)
    watch("claims")
    out: dict[str, Any] = {"claims": judge(register, list_tried(), records, lambda r: store.series_of(folder, r))}
    for name, function in OTHERS:
        watch(name)
        out[name] = function(folder, records)
    watch("wrong")
    out["wrong"] = find_false_successes(records, out.get(files.SYMMETRIES.name, ()))
    return out


def list_tried() -> tuple[RunSpec, ...]:
    """The runs of the maps, each once."""
    return tuple({c.settings_id: c for name in SUITES for c in load_suite(name).specs}.values())


def select_needed(register: Register) -> tuple[RunSpec, ...]:
    """The runs that the claims of ``register`` are tried on."""
    places = [place(s) for s in list_tried()]
    maps = {m.name: m for c in register.claims for m in (c.map, c.against, c.control) if m}.values()
    return tuple({p.spec.settings_id: p.spec for m in maps for p in select(places, m.over)}.values())


def list_whole() -> tuple[RunSpec, ...]:
    """The runs that verdicts are published from."""
    return load_suite(WHOLE).specs


def find_missing(folder: Path, specs: Iterable[RunSpec]) -> list[RunSpec]:
    """Runs that the results in ``folder`` lack."""
    held = {r.settings_id for r in store.load(folder, check_series=False).records}
    return [s for s in specs if s.settings_id not in held]


def write_judgements(folder: Place, judged: dict[str, Any], code: Code) -> list[Path]:
    """One file a judgement, each written whole; claims with digests of the code that they come from."""
    judged = {**judged, files.CLAIMS.name: files.add_code(judged[files.CLAIMS.name], code)}
    files_of = [folder / f"{name}.json" for name in judged]
    for file, found in zip(files_of, judged.values(), strict=True):
        file.write(format_judgement(found))
    return [file.path for file in files_of]


def describe_outdated(folder: Place, now: Code) -> str:
    """One line on what has changed since the verdicts in ``folder`` were published, with the commands; else empty."""
    return describe_changes(bring_forward(files.code_of_claims(folder)), now, WHOLE)


def find_changes(before: Sequence[Claim], after: Sequence[Claim]) -> list[Change]:
    """The claims of which a verdict differs, in the order of the register, those no longer judged last."""
    old, new = ({c.id: c.verdicts for c in claims} for claims in (before, after))
    out = [Change(k, old.get(k, ""), v) for k, v in new.items() if old.get(k, "") != v]
    return out + [Change(k, v, "") for k, v in old.items() if k not in new]
