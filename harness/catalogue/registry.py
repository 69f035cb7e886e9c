"""Register problems and solvers: public modules of ``problems/``, ``solvers/`` and ``solvers/engines/``, unlisted.

A problem file has one function marked ``@problem``, a solver file one dataclass marked ``@solver``.
"""

import dataclasses
import importlib
import inspect
import json
import math
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Annotated, Any, TypeVar, get_args, get_origin

import numpy as np

from ..base.clock import cpu_seconds_of_tree
from ..base.code_meter import code_seconds
from ..base.hints import suggest_name
from ..base.text import check_text
from ..mechanics import so3
from ..mechanics.consistency import check_start, perturb
from ..mechanics.moving_rows import check_lengths
from ..mechanics.presentation import SPACE_AXES, Presentation
from ..mechanics.state import States, rotate_states
from ..mechanics.system import GROUND, MultibodySystem
from ..mechanics.types import Problem, Solver, Trait
from ..mechanics.user_forces import present_laws
from . import mechanism, plugins
from .mechanism import MechanismFile
from .options import Parameter, read_value
from .turns import continue_past_half_turn

T = TypeVar("T")
PROBLEMS, SOLVERS = ("problems",), ("solvers", "solvers/engines")  # folders of our own entries
_MARK, _TESTS = "__mbsbench_name__", "__mbsbench_tests__"  # attributes that the decorators set
MIRRORS = tuple(SPACE_AXES)  # choices of the parameter ``mirror``

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
}  # their words on pages and the checks of symmetries: mechanics/types/presentations.py


@dataclass(frozen=True)
class ProblemEntry:
    """A problem of the catalogue: a function of parameters that creates a ``Problem``."""

    name: str
    make: Callable[..., Problem]
    parameters: Mapping[str, tuple[Any, Parameter]]  # default and meaning, the common ones included
    doc: str
    tests: tuple[Trait, ...] = ()  # what it serves to test


@dataclass(frozen=True)
class SolverEntry:
    """A solver of the catalogue: a dataclass of options that creates a ``Solver``."""

    name: str
    make: Callable[..., Solver]
    parameters: Mapping[str, tuple[Any, Parameter]]
    doc: str
    paper_label: str  # of the default options
    control: str  # dt or rtol: what its accuracy is set by

    def changed_options(self, solver: Solver) -> dict[str, Any]:
        """Return the options of ``solver`` that differ from the defaults."""
        return {k: v for k, (default, _) in self.parameters.items() if (v := getattr(solver, k)) != default}

    def make_solver(self, options: Mapping[str, Any] | None = None) -> Solver:
        """Return the solver with ``options`` (numbers or text); raise ValueError if one is unknown or invalid."""
        return self.make(**_read_values("option", f"solver {self.name}", self.parameters, options or {}))


def read_declaration(solver: Solver) -> tuple[str, float]:
    """Return the name that the paper gives to ``solver`` and the order in dt that it claims (NaN: none).

    Raise TypeError if its attribute ``order`` is not a number > 0 or NaN, or ``paper_label`` is no text.
    """
    label, order = getattr(solver, "paper_label", None), getattr(solver, "order", math.nan)
    where = f"solver {solver.name}"
    label = check_text(f"{where}: paper_label", label)
    if isinstance(order, bool) or not isinstance(order, int | float):
        raise TypeError(f"{where}: order must be a number, the order in dt it claims (got {order!r})")
    if not (math.isnan(order) or 0.0 < order < math.inf):
        raise TypeError(f"{where}: order must be a finite number > 0, or NaN for none (got {order})")
    return label, float(order)


def problem(name: str, tests: Sequence[Trait] = ()) -> Callable[[Callable[..., Problem]], Callable[..., Problem]]:
    """Return a decorator that marks the function of a problem file as the problem ``name``.

    ``tests`` says what the problem serves to test.
    """

    def mark(function: Callable[..., Problem]) -> Callable[..., Problem]:
        """Mark the function with the problem's name and tests, and return it."""
        setattr(function, _MARK, name)
        setattr(function, _TESTS, tuple(Trait(t) for t in tests))
        return function

    return mark


def solver(name: str) -> Callable[[type], type]:
    """Return a decorator that marks the dataclass of a solver file as the solver ``name``.

    Its ``solve`` is wrapped by ``continue_past_half_turn``, unless its attribute ``own_angles`` says that it counts the
    turns of torsional springs itself.
    """

    def mark(cls: Any) -> type:
        """Mark the class with the solver's name, wrap its ``solve`` unless it counts turns itself, and return it."""
        setattr(cls, _MARK, name)
        cls.name = name
        solve = getattr(cls, "solve", None)  # a missing one, or one that is no function, is refused later in one line
        # some engines count turns themselves
        if isinstance(solve, FunctionType) and not getattr(cls, "own_angles", False):
            cls.solve = continue_past_half_turn(solve)
        return cls  # type: ignore[no-any-return]

    return mark


class _Catalogue(Mapping[str, T]):
    """A mapping of names to entries. Our own are imported only when needed, since all together take a second."""

    def __init__(self, folders: Sequence[str], entry: Callable[[str, Any], T], of_plugins: Mapping[str, T]) -> None:
        """Take entries from ``folders`` and plugins; ``entry`` makes an entry from a name and its marked object."""
        self._folders, self._entry, self._of_plugins = folders, entry, of_plugins

    def __getitem__(self, name: str) -> T:
        if name in self._of_plugins:
            return self._of_plugins[name]
        return _import_entry(self._entry, _locate_entries(*self._folders)[name], name)

    def __contains__(self, name: object) -> bool:
        return name in self._of_plugins or name in _locate_entries(*self._folders)

    def __iter__(self) -> Iterator[str]:
        return iter({**_locate_entries(*self._folders), **self._of_plugins})

    def __len__(self) -> int:
        return len(list(iter(self)))


def problems() -> Mapping[str, ProblemEntry]:
    """Return all problems by name, with those of loaded plugins."""
    return _Catalogue(PROBLEMS, _make_problem_entry, _plugin_problems)


def solvers() -> Mapping[str, SolverEntry]:
    """Return all solvers by name, with those of loaded plugins."""
    return _Catalogue(SOLVERS, _make_solver_entry, _plugin_solvers)


def engines() -> Mapping[str, SolverEntry]:
    """Return the solvers that run other people's code, those of ``solvers/engines/``, by name."""
    return {name: solvers()[name] for name in _locate_entries(SOLVERS[1])}


def find_entry(kind: str, name: str, known: Mapping[str, T]) -> T:
    """Return the entry ``name`` of ``known``, problems or solvers (``kind``); raise ValueError if there is none."""
    if name not in known:
        raise ValueError(f"unknown {kind} {name!r}{suggest_name(name, list(known))}")
    return known[name]


def is_own_problem(name: str) -> bool:
    """Return whether ``name`` is a problem of ``problems/``, not of a plugin."""
    return name in _locate_entries(*PROBLEMS)


def is_own_solver(name: str) -> bool:
    """Return whether ``name`` is a solver of ``solvers/``, not of a plugin."""
    return name in _locate_entries(*SOLVERS)


def is_own_class(cls: type) -> bool:
    """Return whether ``cls`` is itself the class of a solver of ``solvers/``; its ``__module__`` might be forged."""
    name = vars(cls).get(_MARK, "")
    return is_own_solver(name) and solvers()[name].make is cls


def make_entry_of_class(cls: type) -> SolverEntry:
    """Return the entry of a class marked ``@solver``, which need not be in the catalogue.

    Raise ValueError if it is not marked, is no valid solver, or has the name of another solver of the catalogue.
    """
    if _MARK not in vars(cls):
        raise ValueError(f"solver must be a name or a dataclass marked @solver (got {cls.__name__})")
    try:
        entry = _make_solver_entry(vars(cls)[_MARK], cls)
    except TypeError as error:
        raise ValueError(str(error)) from None
    known = solvers().get(entry.name)
    if known is not None and known.make is not cls:
        raise ValueError(f"the name {entry.name!r} is taken by a solver of the catalogue")
    return entry


def import_seconds(name: str) -> tuple[float, float]:
    """Return the CPU times [s] that the import of the plugin with the entry ``name`` took, without and for compilation.

    Both are 0 for our own entries. The import may have taken place before this process was forked.
    """
    return _import_seconds.get(name, (0.0, 0.0))


def load_plugin(plugin: Path | str) -> None:
    """Add the entries of a file or entry point (module plugins) to the catalogue; raise ValueError if that fails.

    Unlike a file of ``problems/`` or ``solvers/`` it may define several entries. Names of our own entries are refused.
    A plugin is loaded once; a mechanism's file is read again if it, or a file that it includes, has changed.
    """
    where = plugins.resolve_plugin(str(plugin))
    known = where in _plugin_files
    if known and not _has_changed(where):
        return
    began, code_began = cpu_seconds_of_tree(), code_seconds()
    try:
        named = plugins.load_plugin(where)
        made: list[tuple[str, SolverEntry | ProblemEntry]]
        if isinstance(named, MechanismFile):
            made = [(named.name, _make_mechanism_entry(named))]
        else:
            found = _list_entries(named) if isinstance(named, ModuleType) else _list_marks([named])
            if not found:
                raise ValueError("it marks no @problem and no @solver")
            made = [
                (n, _make_solver_entry(n, o) if isinstance(o, type) else _make_problem_entry(n, o)) for n, o in found
            ]
        taken = sorted({n for n, _ in made} & {*problems(), *solvers()})
        if taken and not known:
            raise ValueError(
                f"the name {taken[0]!r} is taken{_describe_owner(taken[0])}; rename {_describe_kind(named)}"
            )
    except (Exception, SystemExit) as error:  # a plugin may raise anything on import: reported in one line
        raise ValueError(f"plugin {where}: {error or type(error).__name__}") from error
    _plugin_files.add(where)
    if isinstance(named, MechanismFile):
        _mechanisms[where] = named.sha256
    code = code_seconds() - code_began
    spent = max(cpu_seconds_of_tree() - began - code, 0.0)
    _import_seconds.update({n: (spent, code) for n, _ in made})
    _plugin_solvers.update({n: e for n, e in made if isinstance(e, SolverEntry)})
    _plugin_problems.update({n: e for n, e in made if isinstance(e, ProblemEntry)})


def _describe_owner(name: str) -> str:
    """Return the end of a message on a name that is taken: `` by`` with the mechanism's file or the catalogue."""
    others = [w for w in _mechanisms if w in _plugin_files and mechanism.choose_name(w) == name]
    return f" by {others[0]}" if others else " by one of the catalogue"


def _has_changed(where: str) -> bool:
    """Return whether a mechanism's file has changed since it was read, or cannot be read any more."""
    try:
        return where in _mechanisms and mechanism.digest_mechanism(Path(where)) != _mechanisms[where]
    except (OSError, ValueError):
        return True  # reading the file will report the error


def _describe_kind(named: Any) -> str:
    """Return what has to be renamed, for a message: the file of a mechanism, or the entry in a plugin."""
    return "this file" if isinstance(named, MechanismFile) else "the entry"


_mechanisms: dict[str, str] = {}  # digests of mechanisms' files as they were read
_plugin_files: set[str] = set()  # the catalogue of this process, extended only by load_plugin
_import_seconds: dict[str, tuple[float, float]] = {}
_plugin_problems: dict[str, ProblemEntry] = {}
_plugin_solvers: dict[str, SolverEntry] = {}


@cache
def _locate_entries(*folders: str) -> Mapping[str, str]:
    """Return the folder of each of our own entries in ``folders``, by name; a file is named after its entry."""
    root = Path(__file__).resolve().parents[2]
    found = {
        m.name: folder
        for folder in folders
        for m in pkgutil.iter_modules([str(root / folder)])
        if not m.ispkg and not m.name.startswith("_")
    }
    return dict(sorted(found.items()))


@cache
def _import_entry(entry: Callable[[str, Any], T], folder: str, name: str) -> T:
    """Import a file of ``problems/`` or ``solvers/`` and return the entry that ``entry`` makes of its marked object.

    Raise TypeError unless the file marks exactly one object, as ``name``.
    """
    loaded = importlib.import_module(f"...{folder.replace('/', '.')}.{name}", __package__)
    marked = _list_entries(loaded)
    if [n for n, _ in marked] != [name]:
        raise TypeError(f"{folder}/{name}.py must mark one entry, {name!r} (found {[n for n, _ in marked]})")
    return entry(*marked[0])


def make_problem(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """Return the problem ``name``, or the one in a mechanism's file, with ``parameters`` (numbers or text).

    Its start is checked. By its common parameters the start is perturbed, everything is rotated, and the presentation
    and the end time are set; the defaults change nothing. Raise ValueError if anything is invalid.
    """
    if mechanism.is_mechanism(name):
        load_plugin(name)
        name = mechanism.choose_name(name)
    entry = find_entry("problem", name, problems())
    values = _read_values("parameter", f"problem {name}", entry.parameters, parameters or {})
    made = entry.make(**{k: v for k, v in values.items() if k not in COMMON_PARAMETERS})
    made.check_begin()
    check_start(made.system, made.initial, literal=made.literal_start)
    if values["perturb"] > 0.0:
        made = dataclasses.replace(made, initial=perturb(made.system, made.initial, values["perturb"], values["seed"]))
    made = rotate_problem(made, so3.exp(np.array(values["rotation"])) @ _make_yaw(made.system, values["yaw"]))
    presentation = Presentation(**{field.name: values[field.name] for field in dataclasses.fields(Presentation)})
    presentation.system(made.system)  # raises an error for a joint that does not exist
    if values["retrace"] and made.system.is_timed:
        raise ValueError(f"problem {name}: retrace needs a system without functions of time; it has drives or loads")
    t_end = values["t_end"] or made.t_end
    if not 0.0 < t_end < math.inf:
        raise ValueError(f"problem {name}: t_end must be a finite number > 0 [s] (got {t_end})")
    check_lengths(made.system, t_end)
    given = {k: v for k, v in values.items() if v != entry.parameters[k][0]}
    asked = {"parameters": given, "presentation": presentation, "retrace": values["retrace"]}
    return dataclasses.replace(made, t_end=t_end, **asked)


def share_problem(name: str, parameters: Mapping[str, Any] | None = None) -> Problem:
    """Return the problem as ``make_problem`` does; one of our own is made once per process, for callers that read it.

    A suite and its estimate of times request each variant a hundred times. Runs must use ``make_problem`` instead: a
    solver's set-up must not find what another solver has left in the problem.
    """
    try:
        text = json.dumps(parameters or {}, sort_keys=True)
    except TypeError:  # a date of a suite file, which ``make_problem`` refuses in words
        return make_problem(name, parameters)
    return _make_shared_problem(name, text) if is_own_problem(name) else make_problem(name, parameters)


@cache
def _make_shared_problem(name: str, parameters: str) -> Problem:
    """Return one of our own problems from its parameters as JSON."""
    return make_problem(name, json.loads(parameters))


def make_solver(name: str, options: Mapping[str, Any] | None = None) -> Solver:
    """Return the solver ``name`` with ``options`` (numbers or text); raise ValueError if it or an option is unknown."""
    return find_entry("solver", name, solvers()).make_solver(options)


def rotate_problem(p: Problem, Q: np.ndarray) -> Problem:
    """Return the problem ``p`` with all that is fixed in space rotated by ``Q``: the ground's points, gravity, start.

    Its frame is rotated too, by which observables and the reference are converted.
    """
    if np.array_equal(Q, np.eye(3)):
        return p
    start = rotate_states(States.one(p.initial), Q)[0]
    return dataclasses.replace(p, system=_rotate_system(p.system, Q), initial=start, frame=Q @ p.frame)


def _rotate_system(s: MultibodySystem, Q: np.ndarray) -> MultibodySystem:
    """Return the system with all vectors that are fixed in space rotated by ``Q``; those in body frames stay."""

    def rotate(a: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return the vectors ``a`` (n, ..., 3), rotated by Q where ``ends`` (n,) is the ground, read-only."""
        out: np.ndarray = np.where((ends == GROUND).reshape(-1, *[1] * (a.ndim - 1)), a @ Q.T, a)
        out.setflags(write=False)
        return out

    in_space = np.where(s.load_follows, 0, GROUND)
    return dataclasses.replace(
        s,
        gravity=rotate(s.gravity[None], np.array([GROUND]))[0],
        joint_s_j=rotate(s.joint_s_j, s.joint_j),
        joint_n=rotate(s.joint_n, s.joint_j),
        spring_p_j=rotate(s.spring_p_j, s.spring_j),
        torsion_n=rotate(s.torsion_n, s.torsion_j),
        load_force=rotate(s.load_force, in_space),
        load_torque=rotate(s.load_torque, in_space),
        user_law=present_laws(s.user_law, Q),
    )


def _make_yaw(system: MultibodySystem, angle: float) -> np.ndarray:
    """Return the rotation matrix of ``angle`` [rad] about the direction against gravity; about Z without gravity."""
    g = float(np.linalg.norm(system.gravity))
    return so3.exp(angle * (-system.gravity / g if g > 0.0 else np.array([0.0, 0.0, 1.0])))


def _read_values(
    what: str, of: str, known: Mapping[str, tuple[Any, Parameter]], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the values of all ``known`` parameters: those ``given``, parsed from numbers or text, or the defaults.

    Raise ValueError for an unknown name or an invalid value. ``what`` and ``of`` are words of the message, such as
    ``option`` and ``solver rattle``.
    """
    for key in given:
        if key not in known:
            raise ValueError(f"{of} has no {what} {key!r}{suggest_name(key, list(known))}")
    return {k: read_value(k, given[k], default, p) if k in given else default for k, (default, p) in known.items()}


def _list_entries(module: ModuleType) -> list[tuple[str, Any]]:
    """Return name and object of each problem and solver that a module itself defines."""
    return _list_marks([o for o in vars(module).values() if getattr(o, "__module__", None) == module.__name__])


def _list_marks(objects: list[Any]) -> list[tuple[str, Any]]:
    """Return name and object of each of ``objects`` that is itself marked ``@problem`` or ``@solver``."""
    # marks of a base class do not count
    return [(vars(o)[_MARK], o) for o in objects if _MARK in getattr(o, "__dict__", {})]


def _read_first_line(o: Any) -> str:
    """Return the first line of an object's docstring; empty if it has none."""
    return (inspect.getdoc(o) or "").split("\n")[0]


def read_keyword_options(where: str, function: Callable[..., Any], others: int = 0) -> dict[str, tuple[Any, Parameter]]:
    """Return default and ``Parameter`` of each keyword of ``function``, except its first ``others`` parameters.

    Raise TypeError, whose message begins with ``where``, unless all of them are keyword-only, annotated with a
    Parameter, and have a default.
    """
    own: dict[str, tuple[Any, Parameter]] = {}
    for p in list(inspect.signature(function).parameters.values())[others:]:
        notes = get_args(p.annotation)[1:] if get_origin(p.annotation) is Annotated else ()
        note = [a for a in notes if isinstance(a, Parameter)]
        if p.kind is not p.KEYWORD_ONLY or p.default is p.empty or not note:
            raise TypeError(f"{where}: {p.name} must be keyword-only, Annotated with a Parameter, with a default")
        own[p.name] = (p.default, note[0])
    return own


def _make_problem_entry(name: str, function: Callable[..., Problem]) -> ProblemEntry:
    """Return the entry of a function marked ``@problem``, with its own and the common parameters."""
    own = read_keyword_options(f"problem {name}", function)
    tests = getattr(function, _TESTS)
    return ProblemEntry(name, function, {**own, **COMMON_PARAMETERS}, _read_first_line(function), tests)


def _make_mechanism_entry(m: MechanismFile) -> ProblemEntry:
    """Return the entry of a mechanism's file, with its own and the common parameters."""
    return ProblemEntry(m.name, m.problem, {**m.parameters(), **COMMON_PARAMETERS}, m.doc)


def _make_solver_entry(name: str, cls: Any) -> SolverEntry:
    """Return the entry of a class marked ``@solver``; raise TypeError if it lacks anything that a solver must have."""
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
    return SolverEntry(name, cls, own, _read_first_line(cls), read_declaration(cls())[0], cls.control)
