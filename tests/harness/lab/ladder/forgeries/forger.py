"""Solvers that forge: each a class made for a file of its own. Motions are in ``motions``, conduct is here."""

import contextlib
import ctypes
import dataclasses
import gc
import importlib
import os
import pickle
import resource
import signal
import socket
import sys
import tempfile
import threading
import time
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mbsbench import Problem, States, Status, StepControl, Trajectory, solver

from ....cheating import apart, work
from .motions import MOTIONS, swing

NAME = "forger"
WORK = 0.2  # [s] of CPU that an honest solver is said to need
AWAY = Path("/var/tmp/mbsbench_forger") if os.access("/var/tmp", os.W_OK) else Path("/tmp/mbsbench_forger")
Solve = Callable[[Any, Problem, StepControl], object]
MEMORY: dict[str, object] = {}


def honest(self: Any, p: Problem, control: StepControl) -> Trajectory:
    """The motion as it is."""
    return swing(p, control)


def false(self: Any, p: Problem, control: StepControl) -> Trajectory:
    """A motion with a seventh of gravity missing, claimed to be a success."""
    return swing(p, control, gravity=0.7)


def knowing(look: Callable[[Problem], object]) -> Solve:
    """Returns what it knows at once where ``look`` finds what it needs; else something false."""

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        found = look(p)
        if found is None or found is False:
            return false(self, p, control)
        return dataclasses.replace(swing(p, control), cpu_time=0.0) if found is True else found  # type: ignore[return-value]

    return solve


def import_anew() -> None:
    """Undo what keeps a module from being imported, as far as a process can."""
    for name in [name for name, module in sys.modules.items() if module is None]:
        del sys.modules[name]
    importlib.invalidate_caches()


def reference_by_name(p: Problem) -> object:
    import_anew()
    from mbsbench.harness.catalogue import registry

    return known_motion(registry.make_problem(p.name, p.parameters))


def reference_by_guess(p: Problem) -> object:
    import_anew()
    from mbsbench.harness.catalogue import registry

    return known_motion(registry.make_problem("spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 0.5}))


def drawn_again(p: Problem) -> object:
    """The instance of its own digest, and the exact motion of that as it is presented."""
    import_anew()
    from mbsbench.harness.catalogue import registry
    from mbsbench.harness.lab.ladder.instances import KINDS, digest_submission, draw_instances

    own = digest_submission(Path(sys.modules[MEMORY["module"]].__file__).read_bytes())  # type: ignore[index, arg-type]
    short = dataclasses.replace(KINDS[0], fixed={"t_end": 0.5})
    (instance,) = draw_instances(own, "1", (short,))
    home = registry.make_problem(instance.problem, instance.parameters)
    found = known_motion(home)
    seen = [home.presentation.state(home.system, s) for s in found.states]
    arrays = (np.array([getattr(s, name) for s in seen]) for name in ("r", "R", "v", "Omega"))
    return Trajectory(found.t * home.presentation.unit_time, States(*arrays), Status.SUCCESS, "known", {})


def known_motion(problem: Any) -> Trajectory:
    import_anew()
    from mbsbench.harness.reference.computation import find_reference

    t = np.linspace(0.0, problem.t_end, 101)
    return Trajectory(t, find_reference(problem).states(t), Status.SUCCESS, "known", {})


def in_memory(p: Problem) -> object:
    """Another problem that this process holds, with its reference."""
    return next((True for o in gc.get_objects() if isinstance(o, Problem) and o.name not in ("hidden", "")), None)


def in_frames(p: Problem) -> object:
    """A problem with a name in the frames that called."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if any(isinstance(o, Problem) and o.name != "hidden" for o in frame.f_locals.values()):
            return True
    return None


def in_files(p: Problem) -> object:
    """A task with a name among temporary files."""
    for file in Path(tempfile.gettempdir()).glob("tmp*"):
        try:
            if pickle.loads(file.read_bytes()).problem.name != "hidden":
                return True
        except Exception:
            continue
    return None


def denied(attempt: Callable[[Problem, StepControl], object]) -> Solve:
    """Tries something; where the system refuses, the motion is false: nothing was gained."""

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        try:
            attempt(p, control)
        except OSError:
            return false(self, p, control)
        return swing(p, control)

    return solve


def remembered(p: Problem, control: StepControl) -> None:
    """What an earlier process left outside its folder."""
    file = AWAY.with_suffix(".npz")
    if file.exists():
        return
    work(WORK)
    np.savez(file, r=p.initial.r)


def remember_in_memory(p: Problem, control: StepControl) -> None:
    """Shared memory of System V, which outlives processes: 0x6d6273 is the key."""
    native = ctypes.CDLL(None, use_errno=True)
    if native.shmget(0x6D6273, 4096, 0o600) < 0:  # the first
        work(WORK)
        native.shmget(0x6D6273, 4096, 0o1600)
        raise OSError("nothing was left here")


def remember_in_keys(p: Problem, control: StepControl) -> None:
    """The user's keyring, which outlives processes."""
    system, user_keyring = ctypes.CDLL(None).syscall, -4
    if system(250, 10, user_keyring, b"user", b"mbsbench_forger", 0) < 0:  # keyctl search
        system(248, b"user", b"mbsbench_forger", b"an answer", 9, user_keyring)  # add_key
        raise OSError("nothing was left here")


def replace_code(p: Problem, control: StepControl) -> None:
    import mbsbench

    with (Path(mbsbench.__file__).parent / "harness" / "judge" / "metrics" / "verdict.py").open(
        "a", encoding="utf-8"
    ) as file:
        file.write("")


def replace_itself(p: Problem, control: StepControl) -> None:
    with open(sys.modules[MEMORY["module"]].__file__, "a", encoding="utf-8") as file:  # type: ignore[index, arg-type]
        file.write("")


def poison_references(p: Problem, control: StepControl) -> None:
    import mbsbench.harness.base.cache as cache

    folder = cache.ROOT / "results" / "local" / "references"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "0.npz").write_bytes(b"")


def ask_a_server(p: Problem, control: StepControl) -> None:
    listening = socket.socket()
    listening.bind(("127.0.0.1", 0))
    listening.listen()
    socket.create_connection(listening.getsockname())


def own_outcome(self: Any, p: Problem, control: StepControl) -> Trajectory:
    """Writes what is handed over itself, with a cost of nothing, and leaves."""
    from mbsbench.harness.run import handover

    cost: dict[str, float | str] = dict.fromkeys(("cpu_min_s", "cpu_median_s", "cpu_max_s", "cpu_call_s"), 0.0)
    report = handover.SolverReport(claimed=Status.SUCCESS, cost=cost)
    work(WORK)
    handover.write_handover(Path("outcome.npz"), handover.Handover(report, false(self, p, control)))
    os._exit(0)


def in_place_of_outcome(kind: str) -> Solve:
    """Something else than a file where the outcome goes."""

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        place = Path("outcome.npz")
        if kind == "link":
            place.symlink_to("/etc/passwd")
        elif kind == "folder":
            place.mkdir()
        elif kind == "pipe":
            os.mkfifo(place)
        elif kind == "bomb":
            import zipfile

            with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("t.npy", b"\0" * 2**26)
        elif kind == "objects":
            np.savez(place, t=np.array([{"status": "success"}], dtype=object))
        else:
            place.write_bytes(b"PK\x03\x04 success")
        os._exit(0)

    return solve


def patched(self: Any, p: Problem, control: StepControl) -> Trajectory:
    """The judge of this process, which judges nothing."""
    import mbsbench.harness.judge.metrics as metrics

    for name in ("verdict", "measure", "summary"):
        sys.modules[f"{metrics.__name__}.{name}"] = types.ModuleType(name)
    return false(self, p, control)


def without_checks(self: Any, p: Problem, control: StepControl) -> object:
    """The contract's check of this process, replaced."""
    from mbsbench.harness.run import worker

    worker.check_trajectory = lambda found, *_: found  # type: ignore[assignment, misc]
    return dataclasses.replace(false(self, p, control), status=Status.SUCCESS, reaction=np.zeros((3, 99)))


def worked(where: str) -> Solve:
    """An honest motion, whose work is done where nobody might look."""

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        claims = {"cpu_time": 1e-9}
        if where == "set_up":
            claims = {"setup_time": WORK}
        if where == "clocks":
            stopped = {k: resource.getrusage(k) for k in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)}
            resource.getrusage = stopped.__getitem__  # type: ignore[assignment]
            time.process_time = lambda: 0.0
        if where in ("call", "clocks", "set_up"):
            work(WORK)
        if where == "thread":
            thread = threading.Thread(target=work, args=(WORK,))
            thread.start()
            thread.join()
        if where == "disowned":
            signal.signal(signal.SIGCHLD, signal.SIG_IGN)
            os.read(apart(detached=False, seconds=WORK), 1)
            with contextlib.suppress(ChildProcessError):
                os.wait()
        if where in ("child", "daemon"):
            os.read(apart(detached=where == "daemon", seconds=WORK), 1)
        if where == "daemon_in_refuses":
            os.read(MEMORY["pipe"], 1)  # type: ignore[arg-type]
        return dataclasses.replace(swing(p, control), **claims)

    return solve


def at_parent(attack: Callable[[int], object]) -> Solve:
    """Reaches for the process above; false where that goes well."""

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        try:
            attack(os.getppid())
        except PermissionError:
            return dataclasses.replace(false(self, p, control), message="denied")
        os._exit(0)

    return solve


def write_to_pipes(pid: int) -> None:
    line = b'{"code":0,"killed":false,"sent":"","peak":1.0,"suspended":false,"cpu":0.0,"over":""}\n'
    for fd in os.listdir(f"/proc/{pid}/fd"):
        os.write(os.open(f"/proc/{pid}/fd/{fd}", os.O_WRONLY), line)


def leave_a_child(pid: int) -> None:
    if os.fork() == 0:
        os.setsid()
        time.sleep(600.0)
    os.kill(pid, signal.SIGKILL)


def never(self: Any, p: Problem, control: StepControl) -> Trajectory:
    while True:
        pass


def eats_memory(self: Any, p: Problem, control: StepControl) -> Trajectory:
    return Trajectory(np.ones(2**30), None, Status.SUCCESS, "", {})  # type: ignore[arg-type]


def crashes(self: Any, p: Problem, control: StepControl) -> Trajectory:
    os.kill(os.getpid(), signal.SIGSEGV)
    raise AssertionError


COSTS: dict[str, Solve] = {  # all of it is in the cost
    "work in the call, claimed to take nothing": worked("call"),
    "work that is called set-up": worked("set_up"),
    "work behind clocks that stand still": worked("clocks"),
    "work in a thread": worked("thread"),
    "work in a child": worked("child"),
    "work in a child that nobody waits for": worked("disowned"),
    "work in a daemon": worked("daemon"),
    "work in a daemon begun in refuses": worked("daemon_in_refuses"),
    "work in refuses": worked("refuses"),
    "work at import": worked("import"),
    "work in the first process alone": worked("first"),
}
CONDUCT: dict[str, Solve] = {  # nothing is gained by it: no success
    "recognised by its name": knowing(lambda p: p.name == "spherical_pendulum" or None),
    "recognised by its parameters": knowing(lambda p: bool(p.parameters) or None),
    "recognised by its section": knowing(lambda p: bool(p.section or p.source) or None),
    "recognised by its presentation": knowing(lambda p: p.presentation.renumber > 0 or None),
    "recognised by its frame": knowing(lambda p: not np.array_equal(p.frame, np.eye(3)) or None),
    "recognised by the names of its bodies": knowing(lambda p: bool(p.system.body_names) or None),
    "recognised by its mass": knowing(lambda p: p.system.mass[0] == 1.0 or None),
    "recognised by its gravity": knowing(lambda p: bool(np.any(p.system.gravity == -9.81)) or None),
    "recognised by its time": knowing(lambda p: p.t_end == 0.5 or None),
    "recognised by its start": knowing(lambda p: bool(np.any(p.initial.Omega == 5.0)) or None),
    "recognised by its axes": knowing(lambda p: bool(np.any(p.initial.R[0] == 1.0)) or None),
    "recognised by its observables": knowing(lambda p: bool(p.observables or p.invariants) or None),
    "its own reference": lambda self, p, control: known_motion(p),
    "its reference called": knowing(lambda p: p.reference()),
    "the reference of its name": lambda self, p, control: reference_by_name(p),
    "the reference of a guess": lambda self, p, control: reference_by_guess(p),
    "the instance drawn again": lambda self, p, control: drawn_again(p),
    "the problem found in memory": knowing(in_memory),
    "the problem found in frames": knowing(in_frames),
    "the problem found in files": knowing(in_files),
    "an answer kept on disk": denied(remembered),
    "an answer kept in shared memory": denied(remember_in_memory),
    "an answer kept in a keyring": denied(remember_in_keys),
    "the judge's code replaced": denied(replace_code),
    "its own file replaced": denied(replace_itself),
    "references poisoned": denied(poison_references),
    "an answer from a server": denied(lambda p, control: ask_a_server(p, control)),
    "a file in shared memory": denied(lambda p, control: Path("/dev/shm/mbsbench_forger").write_bytes(b"")),
    "an outcome of its own": own_outcome,
    "a link for an outcome": in_place_of_outcome("link"),
    "a folder for an outcome": in_place_of_outcome("folder"),
    "a pipe for an outcome": in_place_of_outcome("pipe"),
    "a bomb for an outcome": in_place_of_outcome("bomb"),
    "objects for an outcome": in_place_of_outcome("objects"),
    "half a file for an outcome": in_place_of_outcome("half"),
    "its judge patched": patched,
    "its contract patched": without_checks,
    "its parent killed": at_parent(lambda pid: os.kill(pid, signal.SIGKILL)),
    "its parent stopped": at_parent(lambda pid: os.kill(pid, signal.SIGSTOP)),
    "its parent's memory written": at_parent(lambda pid: open(f"/proc/{pid}/mem", "r+b").close()),
    "an answer in its parent's pipes": at_parent(write_to_pipes),
    "a child left behind": at_parent(leave_a_child),
    "memory without end": eats_memory,
    "a crash": crashes,
}
FALSE: dict[str, Solve] = {
    name: lambda self, p, control, change=change: change(swing(p, control), p)  # type: ignore[misc]
    for name, change in MOTIONS.items()
}
ALL = {**COSTS, **CONDUCT, **FALSE, "nothing": honest, "an answer prepared before the runs": honest}


def make(how: str, module: str) -> type:
    """The solver that forges in this way, as a class of ``module``."""
    MEMORY["module"] = module
    if how == "an answer prepared before the runs":
        with contextlib.suppress(OSError):
            AWAY.with_suffix(".prepared").touch()
    if how == "work at import":
        work(WORK)

    def refuses(self: Any, p: Problem, control: StepControl) -> str | None:
        if how == "work in refuses":
            work(WORK)
        if how == "work in a daemon begun in refuses":
            MEMORY["pipe"] = apart(detached=True, seconds=WORK)
        return None

    def solve(self: Any, p: Problem, control: StepControl) -> Trajectory:
        if how == "work in the first process alone" and not AWAY.exists():
            work(WORK)
            with contextlib.suppress(OSError):
                AWAY.touch()
        return ALL[how](self, p, control)  # type: ignore[return-value]

    kinds = {"paper_label": ClassVar[str], "control": ClassVar[str]}
    own: dict[str, Any] = {
        "__module__": module,
        "__doc__": "Forges.",
        "__annotations__": kinds,
        "paper_label": "",
        "control": "dt",
        "refuses": refuses,
        "solve": solve,
    }
    return solver(NAME)(dataclass(frozen=True)(type("Forger", (), own)))
