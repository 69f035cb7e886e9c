"""The catalogues: public modules of ``problems/``, ``solvers/`` and ``solvers/engines/`` are entries, listed nowhere.

A problem file holds one function marked ``@problem``, a solver file one dataclass marked ``@solver``.
"""

import dataclasses
import importlib
import inspect
import math
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Annotated, Any, TypeVar, get_args, get_origin

import numpy as np

from ..clock import cpu_seconds_of_tree
from ..code_meter import code_seconds
from ..mechanics import so3
from ..mechanics.consistency import check_start, perturb
from ..mechanics.moving_rows import check_lengths
from ..mechanics.presentation import SPACE_AXES, Presentation
from ..mechanics.state import States, rotate_states
from ..mechanics.system import GROUND, MultibodySystem
from ..mechanics.user_forces import present_laws
from ..text import check_text
from ..types import Problem, Solver, Trait
from . import mechanism_files, plugins
from .mechanism import Mechanism
from .options import Parameter, nearest, read_value
from .turns import counts_turns

T = TypeVar("T")
PROBLEMS, SOLVERS = ("problems",), ("solvers", "solvers/engines")
_MARK, _TESTS = "__mbsbench_name__", "__mbsbench_tests__"
MIRRORS = tuple(SPACE_AXES)

COMMON_PARAMETERS: dict[str, tuple[Any, Parameter]] = {
    "t_end": (0.0, Parameter("simulated time; 0: the problem's own", "s", at_least=0.0)),
    "yaw": (0.0, Parameter("rotate everything, gravity included, about the vertical", "rad")),
    "rotation": ((0.0, 0.0, 0.0), Parameter("rotate everything by this rotation vector, after yaw", "rad")),
    "perturb": (0.0, Parameter("relative size of a random change of the start, then made consistent", at_least=0.0)),
    "seed": (0, Parameter("seed of perturb", "", at_least=0)),
    "mirror": ("none", Parameter("present the mirror image in the plane with this normal", "", choices=MIRRORS)),
    "duplicate": (0, Parameter("declare this joint twice, counted from 1; 0: none", "", at_least=0)),
    "renumber": (0, Parameter("renumber bodies and joints at random with this seed; 0: no change", "", at_least=0)),
    "unit_length": (1.0, Parameter("factor of all lengths: another unit", "", at_least=1e-6, at_most=1e6)),
    "unit_mass": (1.0, Parameter("factor of all masses: another unit", "", at_least=1e-6, at_most=1e6)),
    "unit_time": (1.0, Parameter("factor of all times, dt included: another unit", "", at_least=1e-6, at_most=1e6)),
    "retrace": (False, Parameter("integrate back to the start with reversed velocities")),
}
# The last seven change the presentation, not the problem: the motion is transformed back before it is measured.
PRESENTED = ("mirror", "duplicate", "renumber", "unit_length", "unit_mass", "unit_time")


@dataclass(frozen=True)
class ProblemEntry:
    """A catalogue entry: a function of parameters that makes a ``Problem``."""

    name: str
    make: Callable[..., Problem]
    parameters: Mapping[str, tuple[Any, Parameter]]  # default and meaning, the common ones included
    doc: str
    tests: tuple[Trait, ...] = ()


@dataclass(frozen=True)
class SolverEntry:
    """A catalogue entry: a dataclass of options that makes a ``Solver``."""

    name: str
    make: Callable[..., Solver]
    parameters: Mapping[str, tuple[Any, Parameter]]
    doc: str
    paper_label: str  # of the default options
    control: str

    def changed_options(self, solver: Solver) -> dict[str, Any]:
        """The options of ``solver`` that differ from the defaults."""
        return {k: v for k, (default, _) in self.parameters.items() if (v := getattr(solver, k)) != default}

    def make_solver(self, options: Mapping[str, Any] | None = None) -> Solver:
        """The solver with ``options`` (numbers or text)."""
        return self.make(**_read("option", f"solver {self.name}", self.parameters, options or {}))


def read_declaration(solver: Solver) -> tuple[str, float]:
    """The paper's name of ``solver`` and the order in dt it claims (NaN: none); certificates hold it to that."""
    label, order = getattr(solver, "paper_label", None), getattr(solver, "order", math.nan)
    where = f"solver {solver.name}"
    label = check_text(f"{where}: paper_label", label)
    if isinstance(order, bool) or not isinstance(order, int | float):
        raise TypeError(f"{where}: order must be a number, the order in dt it claims (got {order!r})")
    if not (math.isnan(order) or 0.0 < order < math.inf):
        raise TypeError(f"{where}: order must be a finite number > 0, or NaN for none (got {order})")
    return label, float(order)


def problem(name: str, tests: Sequence[Trait] = ()) -> Callable[[Callable[..., Problem]], Callable[..., Problem]]:
    """Mark the function of a problem file; ``tests`` says what it is there to test."""

    def mark(function: Callable[..., Problem]) -> Callable[..., Problem]:
        setattr(function, _MARK, name)
        setattr(function, _TESTS, tuple(Trait(t) for t in tests))
        return function

    return mark


def solver(name: str) -> Callable[[type], type]:
    """Mark the dataclass of a solver file and name it."""

    def mark(cls: Any) -> type:
        setattr(cls, _MARK, name)
        cls.name = name
        solve = getattr(cls, "solve", None)  # none, or no function, is refused later in a line
        if isinstance(solve, FunctionType) and not getattr(cls, "own_angles", False):  # of engines: they count turns
            cls.solve = counts_turns(solve)
        return cls  # type: ignore[no-any-return]

    return mark


class _Catalogue(Mapping[str, T]):
    """Entries by name. Our own are imported when they are asked for: all together take a second."""

    def __init__(self, folders: Sequence[str], entry: Callable[[str, Any], T], of_plugins: Mapping[str, T]) -> None:
        self._folders, self._entry, self._of_plugins = folders, entry, of_plugins

    def __getitem__(self, name: str) -> T:
        if name in self._of_plugins:
            return self._of_plugins[name]
        return _own_entry(self._entry, _homes(*self._folders)[name], name)

    def __contains__(self, name: object) -> bool:
        return name in self._of_plugins or name in _homes(*self._folders)

    def __iter__(self) -> Iterator[str]:
        return iter({**_homes(*self._folders), **self._of_plugins})

    def __len__(self) -> int:
        return len(list(iter(self)))


def problems() -> Mapping[str, ProblemEntry]:
    """All problems by name, those of loaded plugins included."""
    return _Catalogue(PROBLEMS, _problem_entry, _plugin_problems)


def solvers() -> Mapping[str, SolverEntry]:
    """All solvers by name, those of loaded plugins included."""
    return _Catalogue(SOLVERS, _solver_entry, _plugin_solvers)


def engines() -> Mapping[str, SolverEntry]:
    """Other people's solvers, of ``solvers/engines/``."""
    return {name: solvers()[name] for name in _homes(SOLVERS[1])}


def entry_of(kind: str, name: str, known: Mapping[str, T]) -> T:
    """The entry ``name`` of a catalogue of problems or solvers, or ValueError."""
    if name not in known:
        raise ValueError(f"unknown {kind} {name!r}{nearest(name, list(known))}")
    return known[name]


def is_own_problem(name: str) -> bool:
    """Whether ``name`` is of ``problems/``, not of a plugin."""
    return name in _homes(*PROBLEMS)


def is_own_solver(name: str) -> bool:
    """Whether ``name`` is of ``solvers/``, not of a plugin."""
    return name in _homes(*SOLVERS)


def is_own_class(cls: type) -> bool:
    """Whether ``cls`` makes a solver of ``solvers/``; what it says of itself (``__module__``) may be forged."""
    name = vars(cls).get(_MARK, "")
    return is_own_solver(name) and solvers()[name].make is cls


def solver_entry(cls: type) -> SolverEntry:
    """The entry of a class marked ``@solver`` that need not be in the catalogue, or ValueError."""
    if _MARK not in vars(cls):
        raise ValueError(f"solver must be a name or a dataclass marked @solver (got {cls.__name__})")
    try:
        entry = _solver_entry(vars(cls)[_MARK], cls)
    except TypeError as error:
        raise ValueError(str(error)) from None
    known = solvers().get(entry.name)
    if known is not None and known.make is not cls:
        raise ValueError(f"the name {entry.name!r} is taken by a solver of the catalogue")
    return entry


def import_seconds(name: str) -> tuple[float, float]:
    """CPU times [s] that importing the plugin of this entry took in this process or before its fork; 0 for our own.

    The second is of what was compiled meanwhile, which the first is without.
    """
    return _import_seconds.get(name, (0.0, 0.0))


def load_plugin(plugin: Path | str) -> None:
    """Add the entries of a file or entry point (module plugins), or ValueError; it runs only because it was named.

    Unlike a file of ``problems/`` or ``solvers/`` it may mark several entries. A name of ours cannot be taken.
    """
    where = plugins.resolve_plugin(str(plugin))
    if where in _plugin_files:
        return
    began, code_began = cpu_seconds_of_tree(), code_seconds()
    try:
        named = plugins.load_plugin(where)
        made: list[tuple[str, SolverEntry | ProblemEntry]]
        if isinstance(named, Mechanism):
            made = [(named.name, _mechanism_entry(named))]
        else:
            found = _entries_of(named) if isinstance(named, ModuleType) else _marks_of([named])
            if not found:
                raise ValueError("it marks no @problem and no @solver")
            made = [(n, _solver_entry(n, o) if isinstance(o, type) else _problem_entry(n, o)) for n, o in found]
        taken = sorted({n for n, _ in made} & {*problems(), *solvers()})
        if taken:
            raise ValueError(f"the name {taken[0]!r} is taken")
    except (Exception, SystemExit) as error:  # whatever a plugin does on import: reported in one line
        raise ValueError(f"plugin {where}: {error or type(error).__name__}") from error
    _plugin_files.add(where)
    code = code_seconds() - code_began
    spent = max(cpu_seconds_of_tree() - began - code, 0.0)
    _import_seconds.update({n: (spent, code) for n, _ in made})
    _plugin_solvers.update({n: e for n, e in made if isinstance(e, SolverEntry)})
    _plugin_problems.update({n: e for n, e in made if isinstance(e, ProblemEntry)})


_plugin_files: set[str] = set()  # the catalogue of this process, grown only by load_plugin
_import_seconds: dict[str, tuple[float, float]] = {}
_plugin_problems: dict[str, ProblemEntry] = {}
_plugin_solvers: dict[str, SolverEntry] = {}


@cache
def _homes(*folders: str) -> Mapping[str, str]:
    """The folder of each entry of ours; files bear the names of their entries."""
    root = Path(__file__).resolve().parents[2]
    found = {m.name: folder for folder in folders for m in pkgutil.iter_modules([str(root / folder)])
             if not m.ispkg and not m.name.startswith("_")}  # fmt: skip
    return dict(sorted(found.items()))


@cache
def _own_entry(entry: Callable[[str, Any], T], folder: str, name: str) -> T:
    loaded = importlib.import_module(f"...{folder.replace('/', '.')}.{name}", __package__)
    marked = _entries_of(loaded)
    if [n for n, _ in marked] != [name]:
        raise TypeError(f"{folder}/{name}.py must mark one entry, {name!r} (found {[n for n, _ in marked]})")
    return entry(*marked[0])


def make_problem(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """The problem ``name``, or of a mechanism's file, with ``parameters`` (numbers or text), its start checked."""
    if mechanism_files.is_mechanism(name):
        load_plugin(name)
        name = mechanism_files.name_of(name)
    entry = entry_of("problem", name, problems())
    values = _read("parameter", f"problem {name}", entry.parameters, parameters or {})
    made = entry.make(**{k: v for k, v in values.items() if k not in COMMON_PARAMETERS})
    check_start(made.system, made.initial, literal=made.literal_start)
    if values["perturb"] > 0.0:
        made = dataclasses.replace(made, initial=perturb(made.system, made.initial, values["perturb"], values["seed"]))
    made = in_frame(made, so3.exp(np.array(values["rotation"])) @ _yaw(made.system, values["yaw"]))
    presentation = Presentation(**{k: values[k] for k in PRESENTED})
    presentation.system(made.system)  # says no to a joint that is not there
    if values["retrace"] and made.system.is_timed:
        raise ValueError(f"problem {name}: retrace needs a system without functions of time; it has drives or loads")
    t_end = values["t_end"] or made.t_end
    if not 0.0 < t_end < math.inf:
        raise ValueError(f"problem {name}: t_end must be a finite number > 0 [s] (got {t_end})")
    check_lengths(made.system, t_end)
    given = {k: v for k, v in values.items() if v != entry.parameters[k][0]}
    asked = {"parameters": given, "presentation": presentation, "retrace": values["retrace"]}
    return dataclasses.replace(made, t_end=t_end, **asked)


def make_solver(name: str, options: Mapping[str, Any] | None = None) -> Solver:
    """The solver ``name`` with ``options`` (numbers or text)."""
    return entry_of("solver", name, solvers()).make_solver(options)


def in_frame(p: Problem, Q: np.ndarray) -> Problem:
    """``p`` in a space rotated by ``Q``: ground points and axes, gravity and start; the reference follows."""
    if np.array_equal(Q, np.eye(3)):
        return p
    start = rotate_states(States.one(p.initial), Q)[0]
    return dataclasses.replace(p, system=_turn_system(p.system, Q), initial=start, frame=Q @ p.frame)


def _turn_system(s: MultibodySystem, Q: np.ndarray) -> MultibodySystem:
    def turn(a: np.ndarray, ends: np.ndarray) -> np.ndarray:
        out: np.ndarray = np.where((ends == GROUND).reshape(-1, *[1] * (a.ndim - 1)), a @ Q.T, a)
        out.setflags(write=False)
        return out

    in_space = np.where(s.load_follows, 0, GROUND)
    return dataclasses.replace(
        s,
        gravity=turn(s.gravity[None], np.array([GROUND]))[0],
        joint_s_j=turn(s.joint_s_j, s.joint_j),
        joint_n=turn(s.joint_n, s.joint_j),
        spring_p_j=turn(s.spring_p_j, s.spring_j),
        torsion_n=turn(s.torsion_n, s.torsion_j),
        load_force=turn(s.load_force, in_space),
        load_torque=turn(s.load_torque, in_space),
        user_law=present_laws(s.user_law, Q),
    )


def _yaw(system: MultibodySystem, angle: float) -> np.ndarray:
    """Rotation by ``angle`` about the vertical (opposite to gravity; Z where there is none)."""
    g = float(np.linalg.norm(system.gravity))
    return so3.exp(angle * (-system.gravity / g if g > 0.0 else np.array([0.0, 0.0, 1.0])))


def _read(what: str, of: str, known: Mapping[str, tuple[Any, Parameter]], given: Mapping[str, Any]) -> dict[str, Any]:
    for key in given:
        if key not in known:
            raise ValueError(f"{of} has no {what} {key!r}{nearest(key, list(known))}")
    return {k: read_value(k, given[k], default, p) if k in given else default for k, (default, p) in known.items()}


def _entries_of(module: ModuleType) -> list[tuple[str, Any]]:
    return _marks_of([o for o in vars(module).values() if getattr(o, "__module__", None) == module.__name__])


def _marks_of(objects: list[Any]) -> list[tuple[str, Any]]:
    return [(vars(o)[_MARK], o) for o in objects if _MARK in getattr(o, "__dict__", {})]  # not of a base


def _first_line(o: Any) -> str:
    return (inspect.getdoc(o) or "").split("\n")[0]


def keyword_options(where: str, function: Callable[..., Any], others: int = 0) -> dict[str, tuple[Any, Parameter]]:
    """Default and meaning of the keywords of ``function`` after ``others`` positional arguments, or TypeError."""
    own: dict[str, tuple[Any, Parameter]] = {}
    for p in list(inspect.signature(function).parameters.values())[others:]:
        notes = get_args(p.annotation)[1:] if get_origin(p.annotation) is Annotated else ()
        note = [a for a in notes if isinstance(a, Parameter)]
        if p.kind is not p.KEYWORD_ONLY or p.default is p.empty or not note:
            raise TypeError(f"{where}: {p.name} must be keyword-only, Annotated with a Parameter, with a default")
        own[p.name] = (p.default, note[0])
    return own


def _problem_entry(name: str, function: Callable[..., Problem]) -> ProblemEntry:
    own = keyword_options(f"problem {name}", function)
    tests = getattr(function, _TESTS)
    return ProblemEntry(name, function, {**own, **COMMON_PARAMETERS}, _first_line(function), tests)


def _mechanism_entry(m: Mechanism) -> ProblemEntry:
    return ProblemEntry(m.name, m.problem, {**m.parameters(), **COMMON_PARAMETERS}, m.doc)


def _solver_entry(name: str, cls: Any) -> SolverEntry:
    if not getattr(getattr(cls, "__dataclass_params__", None), "frozen", False):
        raise TypeError(f"solver {name}: {cls.__name__} must be a frozen dataclass (below @solver)")
    if not hasattr(cls, "paper_label"):
        raise TypeError(f"solver {name}: paper_label must be text (got None)")
    if getattr(cls, "control", None) not in ("dt", "rtol"):
        raise TypeError(f"solver {name}: control must be dt or rtol (got {getattr(cls, 'control', None)!r})")
    for what in ("refuses", "solve"):
        if not callable(getattr(cls, what, None)):
            raise TypeError(f"solver {name}: the method {what} is missing")
    for f in dataclasses.fields(cls):
        if "parameter" not in f.metadata or f.default is dataclasses.MISSING:
            raise TypeError(f"solver {name}: {f.name} must be made by mbsbench.option, with a default")
    own = {f.name: (f.default, f.metadata["parameter"]) for f in dataclasses.fields(cls)}
    return SolverEntry(name, cls, own, _first_line(cls), read_declaration(cls())[0], cls.control)
