"""All codes on all mechanisms, in processes of their own: one that crashes costs the mechanism at work."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..mechanics.presentation import SPACE_AXES, Presentation
from ..sandbox.apart import TICK, Apart, Ended
from .drawing import draw_mechanism
from .mechanism import Mechanism
from .oracle import FLOOR, Kind, Oracle, Outcome
from .presenting import Form

CHUNK, MEMORY, CPU = 80, 4000.0, 3.0  # pairs of a process, its [MB], and [s] of CPU time for a pair
UNITS = (1e-3, 0.1, 1.0, 10.0, 1e3)
PARTS = ("split", "rotation", "mirror", "duplicate", "renumber", "units")
Pair = tuple[int, str]  # number of the mechanism, solver


def draw_form(seed: int, number: int, m: Mechanism) -> Form:
    """How mechanism ``number`` is presented: mostly one change, sometimes several."""
    random = np.random.default_rng((seed, number, 2**31))
    possible = [p for p in PARTS if p != "duplicate" or m.connections]
    several = random.random() < 0.25
    parts = [p for p in possible if random.random() < 0.5] if several else []
    parts = parts or [possible[random.integers(len(possible))]]
    plain = Presentation(
        mirror=str(random.choice(list(SPACE_AXES)[1:])) if "mirror" in parts else "none",
        duplicate=int(random.integers(len(m.connections))) + 1 if "duplicate" in parts else 0,
        renumber=int(random.integers(1, 1000)) if "renumber" in parts else 0,
    )
    if "units" in parts:
        units = {f"unit_{n}": float(random.choice(UNITS)) for n in ("length", "mass", "time")}
        plain = Presentation(plain.mirror, plain.duplicate, plain.renumber, **units)
    turned = tuple(float(f"{x:.3g}") for x in random.standard_normal(3)) if "rotation" in parts else (0.0, 0.0, 0.0)
    split = int(random.integers(len(m.bodies))) + 1 if "split" in parts else 0
    return Form(split, "fixed", turned, plain)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Settings:
    """What the trials of a campaign have in common; a form is drawn for each where none is given."""

    seed: int
    floor: float = FLOOR
    options: dict[str, str] = field(default_factory=dict)
    form: Form | None = None

    def oracle(self, number: int) -> Oracle:
        """Mechanism ``number`` in both forms."""
        m = draw_mechanism(self.seed, number)
        return Oracle(m, self.form or draw_form(self.seed, number, m), self.floor)


def run_campaign(settings: Settings, pairs: Sequence[Pair], jobs: int) -> Iterator[Outcome]:
    """The outcomes, each as soon as it is there."""
    _warm(settings.seed, {solver for _, solver in pairs})
    waiting = [list(pairs[k : k + CHUNK]) for k in range(0, len(pairs), CHUNK)][::-1]
    active: list[_Chunk] = []
    try:
        while waiting or active:
            while waiting and len(active) < jobs:
                chunk = waiting.pop()
                active.append(_Chunk(chunk, _begin(settings, chunk)))
            time.sleep(TICK)
            for one in list(active):
                ended = one.process.look()
                sent = (ended.sent if ended else one.process.hear()).split("\n")[one.done : -1]
                one.done += len(sent)
                yield from (msgspec.json.decode(line, type=Outcome) for line in sent)
                if ended is None:
                    continue
                active.remove(one)
                if left := one.pairs[one.done :]:  # a code ended the process
                    yield _crash(left[0], ended)
                    waiting += [left[1:]] if left[1:] else []
    finally:
        for one in active:
            one.process.kill()
            one.process.wait()


@dataclass
class _Chunk:
    """Pairs and the process at work on them; how many are ``done``."""

    pairs: list[Pair]
    process: Apart
    done: int = 0


def _begin(settings: Settings, chunk: Sequence[Pair]) -> Apart:
    def target(send: Callable[[str], None]) -> None:
        oracle, last = None, -1
        for number, solver in chunk:
            if oracle is None or number != last:
                oracle, last = settings.oracle(number), number
            found = replace(oracle.examine(solver, registry.make_solver(solver, settings.options)), number=number)
            send(msgspec.json.encode(found).decode())

    return Apart(target, limit=60.0 + CPU * len(chunk), memory=MEMORY, code=CODE_LIMIT)


def _crash(pair: Pair, ended: Ended) -> Outcome:
    what = "memory" if ended.over == "memory" else f"{ended.over or 'cpu'} time"
    words = f"over its limit of {what}" if ended.at_limit else ended.words
    return Outcome(pair[1], Kind.FAILED if ended.at_limit else Kind.CRASHED, words=words, number=pair[0])


def _warm(seed: int, solvers: Iterable[str]) -> None:
    """Compile our kernels before all forks; other people's codes stay out of this process."""
    own = [s for s in solvers if registry.is_own_solver(s) and s not in registry.engines()]
    oracle = Settings(seed).oracle(0)
    for solver in own:
        oracle.examine(solver)
