"""Figures 4 to 7: the spherical pendulum of Sect. 5.2, released at rest (planar) and with Omega_z = 0.1 rad/s."""

from typing import Any

from .printed import BAUMGARTE, CHART, STARTS, classical, geometric, sound
from .spec import Panel, PaperFigure, Pick, Says, Sketch

PENDULUM, SECTION = "spherical_pendulum", "Sect. 5.2"
SPATIAL = {"omega_z": 0.1}
ALL, SHORT = (0.0, 40.0), (0.0, 2.0)
NAMES = ("ODE-45", "DAE-FI", "DAE-SE")
SOLVERS = ("rk45_strong_form", "ida_index1", "ndf_index1", "ida_index3")
NOT_PRINTED = (BAUMGARTE, CHART, STARTS)

PHI = r"$\|\phi\|$ [m]"
PHI_DOT = r"$\|\dot\phi\|$ [m/s]"
STEP, ENERGY = r"$\Delta t$ [s]", r"$E$ [J]"


def _printed(**parameters: Any) -> tuple[Pick, ...]:
    others = tuple(classical(PENDULUM, name, 1e-3, 0.01, **parameters) for name in NAMES)
    return (*geometric(PENDULUM, 0.01, 1e-3, **parameters), *others)


def _sound(**parameters: Any) -> tuple[Pick, ...]:
    gc = sound(PENDULUM, "gc_weak_form", dt=0.01, **parameters)
    return (gc, *(sound(PENDULUM, name, rtol=1e-8, **parameters) for name in SOLVERS))


def _norms(window: tuple[float, float]) -> tuple[Panel, Panel]:
    return (Panel("constraints", ("phi_norm",), PHI, window, log=True),
            Panel("constraint rates", ("phi_dot_norm",), PHI_DOT, window, log=True))  # fmt: skip


def _step_energy(window: tuple[float, float]) -> tuple[Panel, Panel]:
    return (Panel("step", ("dt",), STEP, window, log=True),
            Panel("mechanical energy", ("energy",), ENERGY, window))  # fmt: skip


def _centre(window: tuple[float, float]) -> tuple[Panel, Panel]:
    return (Panel("centre of mass along OX", ("obs_C_x",), r"$X_C$ [m]", window, exact="ref_C_x"),
            Panel("centre of mass along OZ", ("obs_C_z",), r"$Z_C$ [m]", window, exact="ref_C_z"))  # fmt: skip


def _both(number: int, title: str, rows: tuple, says: tuple[Says, ...], **parameters: Any) -> tuple[PaperFigure, ...]:
    return (
        PaperFigure(number, "as printed", SECTION, title, _printed(**parameters), rows, says, NOT_PRINTED),
        PaperFigure(number, "recommended", SECTION, title, _sound(**parameters), rows, (
            Says("", "error"), Says("", "largest", series="energy_error"))),
    )  # fmt: skip


BIGGEST = "biggest values of both norms: DAE-FI; smallest: ODE-45"
_FI, _SE, _45 = "DAE-FI 0.001", "DAE-SE 0.001", "ODE-45 0.001"

FIGURES = (
    PaperFigure(4, "as printed", SECTION, "The spherical pendulum under gravity", _sound()[:1],
                ((Sketch("", "pendulum", width=12),),), height=1.3),
    *_both(5, "Spherical pendulum released at rest: constraints, step and energy over 2 s",
           (_norms(SHORT), _step_energy(SHORT)),
           (Says(BIGGEST, "order", series="phi_norm", window=SHORT),
            Says(BIGGEST, "order", series="phi_dot_norm", window=SHORT),
            Says("DAE-FI exhibits the most irregular variation of the step", "step", window=SHORT),
            Says("DAE-FI exhibits the worst energy", "order", series="energy_error", window=SHORT))),
    *_both(6, "Spherical pendulum released at rest: displacement, step and energy over 40 s",
           (_centre(ALL), _step_energy(ALL)),
           (Says("DAE-SE unstable at about 20 s, failed at about 32 s", "end", (_SE,), fails_at=32.0),
            Says("DAE-FI ran through, acceptable at the beginning only", "end", (_FI,), runs=True),
            Says("ODE-GC and ODE-45 stay planar, the DAE solvers do not", "largest", series="obs_C_z"),
            Says("irregular steps of both DAE solvers", "step", (_FI, _SE)),
            Says("exceeding increase in energy with DAE-SE", "energy", (_SE,)),
            Says("", "error"))),
    *_both(7, "Spherical pendulum with Omega_z = 0.1 rad/s: constraints, step, energy and displacement",
           (_norms(ALL), _step_energy(ALL), _centre(ALL)),
           (Says("DAE-SE ran over the interval, inaccurate from the very beginning", "end", (_SE,), runs=True),
            Says("DAE-FI failed at about 5.5 s", "end", (_FI,), fails_at=5.5),
            Says("ODE-GC and ODE-45 stay close throughout", "error", ("ODE-GC", "ODE-GC 2", _45)),
            Says("", "error", (_FI, _SE))), **SPATIAL),
)  # fmt: skip
