"""The files of a bundle, made from a results folder and what its problems say they keep: nothing is run anew."""

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..files import FileError, exact, parse_json, read_text
from ..mechanics.joints import KINDS
from ..places import Place
from ..results import store
from ..results.records import COLUMNS, RunRecord, is_literal
from ..results.selection import REACTION, STATE, select_states
from ..results.series import Series
from ..types import Status
from .crate import METADATA, describe_crate
from .invariants import describe_invariants
from .table import make_table

FORMAT, VERSION = "mbsbench bundle", 4
RUN_ID = re.compile(r"[0-9a-f]{8,64}")
TEXT = re.compile(r"[a-z0-9_-]+\.toml|environment\.[0-9a-f]{12}\.json")  # of a results folder
LOCAL = ("executable", "results_folder")  # of an environment: names of this machine
DRAWN = (
    "frame_",
    "exact_",
    "state_",
    "sample_",
    "end_",
    "start_",
    "joint_",
    "system_",
    "last_",
    "bundled_",
)  # no rows along t
SORT = "system_joint_sort"
ENERGY = "energy_error"  # of each state: no state tells the work done
NUMBERS = ("gravity", "joint_i", "system_mass", "system_user_i", SORT, *(f"start_{name}" for name in STATE))
Array = np.ndarray[Any, Any]
NOTHING: Mapping[str, Series] = MappingProxyType({})
FORCES = {  # follow the joints, as joints of one row: the names of their numbers
    "spring": {"i": "i", "j": "j", "s_i": "p_i", "s_j": "p_j", "length": "d0", "k": "k", "c": "c"},
    "torsion": {"i": "i", "j": "j", "u": "u", "n": "n", "length": "rest", "k": "k", "c": "c"},
    "load": {"i": "i", "s_i": "p", "u": "force", "w": "torque", "length": "follows", "motion": "factor"},
}


@dataclass
class _Exact:
    """Exact states of a problem at the times of all its runs, each kept once."""

    about: dict[str, Any]
    at: dict[float, dict[str, Array]] = field(default_factory=dict)

    def add(self, series: Series, chosen: Array) -> None:
        for k in np.flatnonzero(chosen):
            state = {name: series[f"sample_{name}"][k] for name in (*STATE, "error")}
            self.at.setdefault(float(series["sample_t"][k]), state)

    def matrix(self) -> bytes:
        times = sorted(self.at)
        stated, *states = (np.array([self.at[t][name] for t in times]) for name in ("error", *STATE))
        return _write_states(stated, np.array(times), *states)


def list_contents(
    folder: Path, records: Iterable[RunRecord], *, lossless: bool, again: Mapping[str, Series] = NOTHING
) -> Iterator[tuple[str, bytes]]:
    """Name and content of each file of the bundle but the manifest, in order.

    ``again``: series of runs that were solved again, by run_id.
    """
    records, files = sorted(records, key=lambda r: r.run_id), dict[str, tuple[str, int]]()
    for name, content in _list_data(folder, records, again, lossless=lossless):
        files[name] = hashlib.sha256(content).hexdigest(), len(content)
        yield name, content
    yield METADATA, _json(describe_crate(files, records, lossless=lossless))


def _list_data(
    folder: Path, records: Sequence[RunRecord], again: Mapping[str, Series], *, lossless: bool
) -> Iterator[tuple[str, bytes]]:
    runs, exact_of = list[dict[str, Any]](), dict[str, _Exact]()
    codes = sorted({r.code for r in records})
    yield "bundle.json", _json({"format": FORMAT, "version": VERSION, "lossless": lossless, "codes": codes})
    yield from _texts(folder)
    yield "records.json", _json([{c.name: exact(getattr(r, c.name)) for c in COLUMNS} for r in records])
    yield "table.json", _json(make_table(records))
    for record in records:
        if not RUN_ID.fullmatch(record.run_id):
            raise FileError(f"{record.run_id!r} is no id of a run")
        run: dict[str, Any] = {"run_id": record.run_id, "problem": "", "states": "none", "peaks_s": {}, "arrays": {}}
        run |= {"reaction": list[float](), "between": False}
        with _whole_series(record):
            series = again.get(record.run_id) or store.series_of(folder, record)
            if series is not None and "state_t" in series:
                _check_arrays(record, series)
                problem = _describe_problem(record, series)
                run["problem"] = name = hashlib.sha256(_json(problem)).hexdigest()[:16]
                chosen, exact_ones, run["between"] = select_states(series)
                chosen = chosen | lossless
                if lossless and len(chosen) <= record.steps and record.claimed == Status.SUCCESS:
                    kept = f"{len(chosen)} of its {record.steps + 1} states"
                    raise FileError(
                        f"run {record.run_id} keeps {kept}: run its suite with --lossless, or bundle without"
                    )
                exact_of.setdefault(name, _Exact(problem)).add(series, exact_ones | lossless)
                run["peaks_s"] = dict(series.peaks)
                if "state_reaction" in series and REACTION in series.peaks:
                    (at,) = np.flatnonzero(series["state_t"] == series.peaks[REACTION])
                    run["reaction"] = series["state_reaction"][at].tolist()
                if np.any(chosen):
                    every = np.all(chosen) and len(chosen) == len(series["t"])
                    run["states"] = "every step" if every else "some steps"
                    states = (series[f"state_{key}"][chosen] for key in ("t", *STATE))
                    yield f"runs/{record.run_id}.npy", _write_states(_energy_of_states(series)[chosen], *states)
                if lossless:
                    run["arrays"], content = _pack(_rows(series))
                    yield f"series/{record.run_id}.npy", content
        runs.append(run)
    yield "runs.json", _json(runs)
    for name, known in sorted(exact_of.items()):
        if known.at:
            yield f"references/{name}.npy", known.matrix()
        yield f"problems/{name}.json", _json(known.about)


@contextlib.contextmanager
def _whole_series(record: RunRecord) -> Iterator[None]:
    """FileError that names the run where its series holds arrays of other types or shapes than a run leaves."""
    try:
        yield
    except FileError:
        raise
    except (ValueError, TypeError, IndexError, KeyError, OverflowError):
        raise FileError(f"the series of run {record.run_id} are not whole: run it again") from None


def _check_arrays(record: RunRecord, series: Series) -> None:
    """FileError unless states and exact states are there as they should be, and all numbers of the problem."""
    if "end_turns" in series and np.any(series["end_turns"]):
        raise FileError(f"run {record.run_id}: its torsional springs turn beyond half a turn about rest, which states "
                        "do not tell; leave it out")  # fmt: skip
    nb = len(series["system_mass"]) if "system_mass" in series else -1
    shape = {"t": (), "r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 3), "Omega": (nb, 3), "error": ()}
    whole = all(name in series for name in (*NUMBERS, "t", ENERGY)) and bool(
        np.all(np.isin(series[SORT], np.arange(len(KINDS))))
    )
    for kind, names in (("state", tuple(shape)[:-1]), ("sample", tuple(shape))):
        if f"{kind}_t" in series:
            found = (series.arrays.get(f"{kind}_{name}", np.zeros((0, 0))) for name in names)
            whole &= all(a.shape[1:] == shape[n] and a.dtype == float for n, a in zip(names, found, strict=True))
    if not whole or any(not np.all(np.isfinite(series[name])) for name in NUMBERS):
        raise FileError(f"the series of run {record.run_id} are not whole: run it again")


def _energy_of_states(series: Series) -> Array:
    """The energy error of each state; a file of every step has it in its rows."""
    if f"state_{ENERGY}" in series:
        return series[f"state_{ENERGY}"]
    return series[ENERGY][np.searchsorted(series["t"], series["state_t"])]


def _rows(series: Series) -> dict[str, Array]:
    """All that the series holds along its times, and the reactions of its states."""
    rows = {name: a for name, a in series.arrays.items() if not name.startswith(DRAWN) and a.shape == series["t"].shape}
    return rows | {name: a for name, a in series.arrays.items() if name == "state_reaction"}


def _describe_problem(record: RunRecord, series: Series) -> dict[str, Any]:
    """Every number of the problem of a run, from its series."""
    plain = {"gravity": series["gravity"], **{k: a for k, a in series.arrays.items() if k.startswith("joint_")}}
    plain |= {k.removeprefix("system_"): a for k, a in series.arrays.items() if k.startswith("system_")}
    plain |= {k: a for k, a in series.arrays.items() if k.startswith("start_")}
    kinds = [str(KINDS[k]) for k in plain.pop("joint_sort")]
    kinds += [force for force in FORCES for _ in plain[f"{force}_i"]]
    plain = _add_forces(plain)
    return {
        "problem": record.problem, "parameters": parse_json(record.problem_parameters, "parameters"),
        "t_end_s": record.t_end_s, "literal_start": is_literal(record), "section": record.section,
        "body_names": series.body_names, "joint_names": series.joint_names, "joint_kinds": kinds,
        "not_serialised": [f"user force {k}" for k in range(len(plain["user_i"]))],
        "invariants": describe_invariants(record.problem, record.problem_parameters),
        "reference": {
            "kind": series.reference, "route": record.reference, "horizon_s": exact(record.reference_horizon_s),
        },
        "numbers": {name: a.tolist() for name, a in sorted(plain.items())},
    }  # fmt: skip


def _add_forces(plain: Mapping[str, Array]) -> dict[str, Array]:
    """The numbers of a problem, its forces added to its joints."""
    own = {name: a for name, a in plain.items() if not name.startswith(tuple(f"{force}_" for force in FORCES))}
    own |= {f"joint_{key}": np.zeros(len(own["joint_i"])) for key in ("k", "c")}
    for force, names in FORCES.items():
        size = len(plain[f"{force}_i"])
        numbers = {key: plain[f"{force}_{name}"] for key, name in names.items()}
        numbers |= {"moving": np.ones(size)} | ({} if "j" in names else {"j": np.full(size, -1.0)})
        for name in [name for name in own if name.startswith("joint_")]:
            rows = np.zeros((size, *own[name].shape[1:]))
            given = numbers.get(name.removeprefix("joint_"), rows)
            rows[tuple(slice(n) for n in given.shape)] = given  # two normals of three
            own[name] = np.concatenate([own[name], rows])
    return own


def _write_states(stated: Array, *states: Array) -> bytes:
    """A matrix: times, then each number of each body along them, and what is stated."""
    t, r, *_ = states
    bodies = np.concatenate([a.reshape(*r.shape[:2], -1) for a in states[1:]], axis=2)
    return _write_npy(np.concatenate([t[None], bodies.reshape(len(t), -1).T, stated[None]]))


def _pack(arrays: Mapping[str, Array]) -> tuple[dict[str, Any], bytes]:
    """Arrays as one vector, and where each begins: {name: [offset, shape]}."""
    index, offset = dict[str, Any](), 0
    for name, a in arrays.items():
        index[name] = [offset, list(a.shape)]
        offset += a.size
    return index, _write_npy(np.concatenate([np.zeros(0), *(a.ravel() for a in arrays.values())]))


def _write_npy(a: Array) -> bytes:
    """An NPY file with the same bytes from every version of NumPy."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {a.shape}, }}"
    head += " " * (-(len(head) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + np.asarray(a, "<f8").tobytes()


def _texts(folder: Path) -> Iterator[tuple[str, bytes]]:
    """The suite of a results folder with those it includes, and its environments."""
    here = Place(folder)
    for name in filter(TEXT.fullmatch, here.names()):
        text = read_text(here / name, name)
        if name.startswith("environment."):
            plain = parse_json(text, name)
            text = json.dumps({k: v for k, v in plain.items() if k not in LOCAL}, indent=1, sort_keys=True)
        yield name, text.encode()


def _json(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
