"""All judgements of a run, as files: ``<run>/judgement/*.json``, and what changed against the published ones."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..results import store
from ..results.records import RunRecord
from ..suites.spec import RunSpec
from ..suites.suite import load_suite
from .certificates.drift import anatomy
from .certificates.metamorphic import scorecard
from .certificates.orders import certify
from .certificates.work import work
from .claims.register import Register
from .claims.verdicts import judge
from .wrong import wrong

FOLDER = "judgement"
PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "published"
SUITES = ("paper", "claims")  # their runs are what claims are tried on; both are in the suite ``referee``
OTHERS: tuple[tuple[str, Callable[[Path, Sequence[RunRecord]], Any]], ...] = (
    ("certificates", certify),
    ("drift", anatomy),
    ("metamorphic", scorecard),
    ("work", work),
)


@dataclass(frozen=True)
class Change:
    """A claim judged otherwise than before; empty where it was not judged."""

    id: str
    before: str
    after: str


def judgements(folder: Path, register: Register, watch: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Every judgement by the name of its file; a run that holds too little has claims that say so."""
    records = store.load(folder, check_series=False).records
    watch("claims")
    out: dict[str, Any] = {"claims": judge(register, tried_on(), records, lambda r: series_of(folder, r))}
    for name, function in OTHERS:
        watch(name)
        out[name] = function(folder, records)
    watch("wrong")
    out["wrong"] = wrong(records, out.get("metamorphic", ()))
    return out


def tried_on() -> tuple[RunSpec, ...]:
    """The runs of the maps, each once."""
    found = {c.settings_id: c for name in SUITES for c in load_suite(name).specs}
    return tuple(found.values())


def series_of(folder: Path, record: RunRecord) -> Any:
    """The series of a run, None where there is none."""
    return store.series_of(folder, record)


def write(folder: Path, judged: dict[str, Any]) -> list[Path]:
    """One file a judgement, each written whole."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.json" for name in judged]
    for path, plain in zip(paths, judged.values(), strict=True):
        store.write_text(path, as_text(plain))
    return paths


def read_claims(folder: Path) -> list[dict[str, Any]] | None:
    """The claims judged in ``folder``; None where there are none."""
    path = folder / "claims.json"
    if not path.exists():
        return None
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(plain, list) or not all({"id", "verdict"} <= row.keys() for row in plain):
            raise ValueError("not a list of verdicts")
    except (OSError, ValueError, AttributeError) as error:
        raise store.StoreError(f"cannot read {path}: {error}; --publish writes it anew") from None
    return plain


def changes(before: Sequence[dict[str, Any]], after: Sequence[dict[str, Any]]) -> list[Change]:
    """The claims whose verdict differs, in the order of the register, those that went last."""
    old, new = ({c["id"]: c["verdict"] for c in rows} for rows in (before, after))
    out = [Change(k, old.get(k, ""), v) for k, v in new.items() if old.get(k, "") != v]
    return out + [Change(k, v, "") for k, v in old.items() if k not in new]


def as_text(plain: Any) -> str:
    """Strict JSON of which a diff can be read: a line a row of every inner list; numbers that do not exist are null."""
    return _text(plain, 0) + "\n"


def _text(plain: Any, depth: int) -> str:
    pad = " " * (depth + 1)
    if isinstance(plain, dict) and plain and depth < 2:
        rows = [f"{json.dumps(k, ensure_ascii=False)}: {_text(v, depth + 1)}" for k, v in plain.items()]
        return "{\n" + ",\n".join(pad + r for r in rows) + "\n" + pad[:-1] + "}"
    if isinstance(plain, list) and any(isinstance(v, dict | list) for v in plain):
        return "[\n" + ",\n".join(pad + _text(v, depth + 1) for v in plain) + "\n" + pad[:-1] + "]"
    return json.dumps(_finite(plain), ensure_ascii=False, allow_nan=False)


def _finite(plain: Any) -> Any:
    if isinstance(plain, float) and not abs(plain) < float("inf"):
        return None
    if isinstance(plain, dict):
        return {k: _finite(v) for k, v in plain.items()}
    if isinstance(plain, list | tuple):
        return [_finite(v) for v in plain]
    return plain
