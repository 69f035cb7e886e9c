"""Run all codes on all mechanisms, in separate processes: one that crashes loses only the mechanism at work."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from ...base.code_meter import CODE_LIMIT
from ...base.forked_process import TICK, ForkedProcess, ProcessEnd
from ...catalogue import registry
from ...mechanics.presentation import SPACE_AXES, Presentation
from .drawing import draw_mechanism
from .mechanism import RandomMechanism
from .oracle import FLOOR, Behaviour, Oracle, OracleOutcome
from .presenting import Form

CHUNK, MEMORY, CPU = 80, 4000.0, 3.0  # pairs for a process, its memory [MB], and CPU time [s] for a pair
UNITS = (1e-3, 0.1, 1.0, 10.0, 1e3)
PARTS = ("split", "rotation", "mirror", "duplicate", "renumber", "units")
Pair = tuple[int, str]  # number of the mechanism, solver


def draw_form(seed: int, number: int, m: RandomMechanism) -> Form:
    """Draw the form in which mechanism ``m``, number ``number`` of a campaign, is presented: the same one every time.

    Three times in four it has one change of ``PARTS``, else each of them with probability 1/2, and one at least.
    """
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
class CampaignSettings:
    """The settings that all trials of a campaign share; without ``form`` one is drawn for each mechanism."""

    seed: int
    floor: float = FLOOR  # fraction of the mechanism's size below which no deviation counts
    options: dict[str, str] = field(default_factory=dict)  # options of the solvers
    form: Form | None = None

    def make_oracle(self, number: int) -> Oracle:
        """Draw mechanism ``number``, and its form unless one is given, and return the oracle of both."""
        m = draw_mechanism(self.seed, number)
        return Oracle(m, self.form or draw_form(self.seed, number, m), self.floor)


def choose_settings(seed: int, floor: float, options: dict[str, str], form: dict[str, str] | None) -> CampaignSettings:
    """Return the settings of a campaign; its ``form`` is given by words, such as {"split": "2"}, or None to draw it."""
    return CampaignSettings(seed, floor, options, Form.parse(form) if form else None)


def run_campaign(settings: CampaignSettings, pairs: Sequence[Pair], jobs: int) -> Iterator[OracleOutcome]:
    """Run the solver of each pair on its mechanism, in up to ``jobs`` processes; yield each outcome when it is known.

    A pair during which its process ends has the outcome crashed, or failed at a limit; the next pairs run in another
    process. Kernels are compiled before.
    """
    _compile_kernels(settings.seed, {solver for _, solver in pairs})
    waiting = [list(pairs[k : k + CHUNK]) for k in range(0, len(pairs), CHUNK)][::-1]
    active: list[_Chunk] = []
    try:
        while waiting or active:
            while waiting and len(active) < jobs:
                chunk = waiting.pop()
                active.append(_Chunk(chunk, _start_process(settings, chunk)))
            time.sleep(TICK)
            for one in list(active):
                ended = one.process.check_end()
                sent = (ended.sent if ended else one.process.read_lines()).split("\n")[one.done : -1]
                one.done += len(sent)
                yield from (msgspec.json.decode(line, type=OracleOutcome) for line in sent)
                if ended is None:
                    continue
                active.remove(one)
                if left := one.pairs[one.done :]:  # the code that was running ended the process
                    yield _make_end_outcome(left[0], ended)
                    waiting += [left[1:]] if left[1:] else []
    finally:
        for one in active:
            one.process.kill()
            one.process.wait()


@dataclass
class _Chunk:
    """Pairs, the process that examines them, and the number of pairs that are ``done``."""

    pairs: list[Pair]
    process: ForkedProcess
    done: int = 0


def _start_process(settings: CampaignSettings, chunk: Sequence[Pair]) -> ForkedProcess:
    """Start the process that examines a chunk of pairs and sends each outcome as a line of JSON."""

    def target(send: Callable[[str], None]) -> None:
        """Examine the pairs of the chunk one by one."""
        oracle, last = None, -1
        for number, solver in chunk:
            if oracle is None or number != last:
                oracle, last = settings.make_oracle(number), number
            found = replace(oracle.examine(solver, registry.make_solver(solver, settings.options)), number=number)
            send(msgspec.json.encode(found).decode())

    return ForkedProcess(target, limit=60.0 + CPU * len(chunk), memory=MEMORY, code=CODE_LIMIT)


def run_apart(work: Callable[[], str], cpu: float) -> str:
    """Return what ``work`` returns in a separate process of at most ``cpu`` [s]; empty if that ends without it."""
    return ForkedProcess(lambda send: send(work()), limit=cpu, memory=MEMORY, code=CODE_LIMIT).wait().sent


def _make_end_outcome(pair: Pair, ended: ProcessEnd) -> OracleOutcome:
    """Return the outcome of a pair during which its process ended: failed at a limit, else crashed."""
    what = "memory" if ended.over == "memory" else f"{ended.over or 'cpu'} time"
    words = f"over its limit of {what}" if ended.at_limit else ended.words
    return OracleOutcome(
        pair[1], Behaviour.FAILED if ended.at_limit else Behaviour.CRASHED, words=words, number=pair[0]
    )


def _compile_kernels(seed: int, solvers: Iterable[str]) -> None:
    """Compile the kernels of these solvers before any fork, by examining mechanism 0; skip engines and plugins."""
    own = [s for s in solvers if registry.is_own_solver(s) and s not in registry.engines()]
    oracle = CampaignSettings(seed).make_oracle(0)
    for solver in own:
        oracle.examine(solver)
