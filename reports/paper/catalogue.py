"""The paper's twelve figures as data: as printed and, where they compare solvers, with the recommended settings.

Settings are in ``harness/suites/paper.toml``, what the paper claims in ``results/claims.toml``.
"""

from ..plots.spec import Axis
from .spec import PRINTED, RECOMMENDED, Panel, PaperFigure, Pick, Sketch, Window

BODY, CHAIN, TOP, GRID = "torque_free_body[t_end=300]", "chain", "heavy_top", "four_bar_grid"
PENDULUM, SPATIAL = "spherical_pendulum", "spherical_pendulum[omega_z=0.1]"
GC, AL = "gc_weak_form", "gc_augmented_lagrangian"
RK, FI, SE, INDEX3 = "rk45_strong_form", "ida_index1", "ndf_index1", "ida_index3"

ENERGY = Axis("energy", "J", symbol="E")
STEP = Axis("step", "s", log=True, symbol=r"\Delta t")
PHI = Axis("constraints", "m", log=True, symbol=r"\|\phi\|")
PHI_DOT = Axis("constraint rates", "m/s", log=True, symbol=r"\|\dot\phi\|")
OMEGA, OMEGA_AXIS = ("obs_Omega_x", "obs_Omega_y", "obs_Omega_z"), Axis("Omega", "rad/s", symbol=r"\Omega")
OMEGA_LABELS = (r"$\Omega_x$", r"$\Omega_y$", r"$\Omega_z$")

TOLERANCES = "the tolerances (those in the legend are ours)"
GAINS = "the gains C_B and K_B of Eq. (94)"
JACOBIANS = "whether MATLAB's Jacobians were exact, its error norms and orders"
DIRECTION = "the direction c_R of Eq. (31): both choices are drawn"
STARTS = "the starting values of sigma and mu"
INERTIA = "the axial inertia of the bars"
CODES = "(ADAMS and MotionSolve are not run: IDA on the index-3 equations is of the class of both)"
PENALTIES = "the tolerance and penalties of the augmented Lagrangian"
JOINT_A = "which joint is A: the bottom left one is drawn"
BENCHMARK = "the benchmark's curves: the certified exact motion is drawn"


def _pick_recommended(variant: str, *solvers: str, every: bool = False) -> Pick:
    return Pick(RECOMMENDED, variant, solvers, every)


def _sketch(number: int, section: str, title: str, variant: str, view: str, height: float) -> PaperFigure:
    rows = ((Sketch("", view, width=12),),)
    return PaperFigure(number, PRINTED, section, title, (_pick_recommended(variant, GC),), rows, height=height)


def _torque_free(number: int, solver: str, title: str, rows: tuple, height: float) -> tuple[PaperFigure, ...]:
    def figure(label: str, not_printed: tuple[str, ...]) -> PaperFigure:
        picks = Pick(label, BODY, (solver,)), _pick_recommended(BODY, GC, every=True)
        return PaperFigure(number, label, "Sect. 5.1", title, picks, rows, not_printed, height)

    gains = () if solver == RK else (GAINS,)
    return figure(PRINTED, (TOLERANCES, *gains, JACOBIANS)), figure(RECOMMENDED, ())


def _torque_free_dae(number: int, solver: str, name: str) -> tuple[PaperFigure, ...]:
    rows = (
        (Panel("angular velocity", OMEGA, OMEGA_AXIS, (0.0, 300.0), labels=OMEGA_LABELS, width=8),
         Panel("", OMEGA, OMEGA_AXIS, (290.0, 300.0), continued=True, width=4)),
        (Panel("mechanical energy", ("energy",), ENERGY, (0.0, 300.0), width=12),),
    )  # fmt: skip
    return _torque_free(number, solver, f"Torque-free motion with {name}: angular velocity and energy", rows, 2.1)


def _both(number: int, section: str, title: str, variant: str, rows: tuple, not_printed: tuple[str, ...],
          printed: tuple[str, ...] = (GC, RK, FI, SE), height: float = 1.75) -> tuple[PaperFigure, ...]:  # fmt: skip
    every = _pick_recommended(variant, GC, RK, FI, SE, INDEX3)
    return (
        PaperFigure(number, PRINTED, section, title, (Pick(PRINTED, variant, printed),), rows, not_printed, height),
        PaperFigure(number, RECOMMENDED, section, title, (every,), rows, height=height),
    )


def _pendulum(number: int, title: str, variant: str, *rows: tuple) -> tuple[PaperFigure, ...]:
    return _both(number, "Sect. 5.2", title, variant, rows, (GAINS, DIRECTION, STARTS, JACOBIANS))


def _norms(window: Window) -> tuple[Panel, Panel]:
    return (Panel("constraints", ("phi_norm",), PHI, window),
            Panel("constraint rates", ("phi_dot_norm",), PHI_DOT, window))  # fmt: skip


def _step_energy(window: Window) -> tuple[Panel, Panel]:
    return (Panel("step", ("dt",), STEP, window),
            Panel("mechanical energy", ("energy",), ENERGY, window))  # fmt: skip


def _centre(window: Window) -> tuple[Panel, Panel]:
    return (_exact("centre of mass along OX", "C_x", "X_C", "m", window[1]),
            _exact("centre of mass along OZ", "C_z", "Z_C", "m", window[1]))  # fmt: skip


def _exact(title: str, name: str, symbol: str, unit: str, t_end: float) -> Panel:
    return Panel(title, (f"obs_{name}",), Axis(name, unit, symbol=symbol), (0.0, t_end), exact=f"ref_{name}")


_GRID_TITLE = "Grid of four-bar linkages: start, energy, first row, a bottom joint"
_GRID_ROWS = (
    (Sketch("initial position", "grid"),
     Panel("mechanical energy", ("energy",), ENERGY, (0.0, 10.0), band=True)),
    (_exact("first row, angular position", "angle_1", r"\varphi_1", "rad", 10.0),
     _exact("first row, angular velocity", "rate_1", r"\dot\varphi_1", "rad/s", 10.0)),
    (_exact("joint A, Y", "bottom_left_y", r"Y_A", "m", 10.0),
     _exact("joint A, Z", "bottom_left_z", r"Z_A", "m", 10.0)),
)  # fmt: skip

FIGURES: tuple[PaperFigure, ...] = (
    *_torque_free(1, RK, "Torque-free motion: the body, its angular velocity and its energy", (
        (Sketch("the body", "rods", width=4),
         Panel("angular velocity", OMEGA, OMEGA_AXIS, (0.0, 50.0), labels=OMEGA_LABELS, width=8)),
        (Panel("mechanical energy", ("energy",), ENERGY, (0.0, 50.0), width=12),)), 1.75),
    *_torque_free_dae(2, FI, "DAE-FI"),
    *_torque_free_dae(3, SE, "DAE-SE"),
    _sketch(4, "Sect. 5.2", "The spherical pendulum under gravity", PENDULUM, "pendulum", 1.3),
    *_pendulum(5, "Spherical pendulum released at rest: constraints, step and energy over 2 s", PENDULUM,
               _norms((0.0, 2.0)), _step_energy((0.0, 2.0))),
    *_pendulum(6, "Spherical pendulum released at rest: displacement, step and energy over 40 s", PENDULUM,
               _centre((0.0, 40.0)), _step_energy((0.0, 40.0))),
    *_pendulum(7, "Spherical pendulum with Omega_z = 0.1 rad/s: constraints, step, energy and displacement", SPATIAL,
               _norms((0.0, 40.0)), _step_energy((0.0, 40.0)), _centre((0.0, 40.0))),
    _sketch(8, "Sect. 5.3", "The chain at rest on its four supports", CHAIN, "chain", 1.15),
    *_both(9, "Sect. 5.3", "Chain: energy over 2 s and 20 s, displacement of E out of the plane, step", CHAIN, (
        (Panel("energy over 2 s", ("energy",), ENERGY, (0.0, 2.0)),
         Panel("energy over 20 s", ("energy",), ENERGY, (0.0, 20.0), tightest=True)),
        (Panel("out of the plane", ("obs_E_z",), Axis("Z_E", "m", symbol="Z_E"), (0.0, 20.0), tightest=True),
         Panel("step", ("dt",), STEP, (0.0, 20.0)))),
        (TOLERANCES, INERTIA, DIRECTION, STARTS, CODES), printed=(GC, INDEX3), height=2.0),
    _sketch(10, "Sect. 5.4", "The spinning top", TOP, "top", 2.3),
    *_both(11, "Sect. 5.4", "Spinning top in cuspidal motion: nutation, precession rate, step and energy", TOP, (
        (_exact("nutation angle", "theta", r"\theta", "deg", 5.0),
         _exact("precession rate", "phi_dot", r"\dot\varphi", "rad/s", 5.0)),
        _step_energy((0.0, 5.0))), (GAINS, DIRECTION, STARTS, JACOBIANS, "when DAE-FI fails")),
    PaperFigure(12, PRINTED, "Sect. 5.5", _GRID_TITLE, (Pick(PRINTED, GRID, (AL,)), _pick_recommended(GRID, AL)),
                _GRID_ROWS, (PENALTIES, JOINT_A, BENCHMARK, INERTIA)),
    PaperFigure(12, RECOMMENDED, "Sect. 5.5", _GRID_TITLE, (_pick_recommended(GRID, AL, RK, FI, SE, INDEX3),),
                _GRID_ROWS, (JOINT_A, BENCHMARK, INERTIA)),
)  # fmt: skip
