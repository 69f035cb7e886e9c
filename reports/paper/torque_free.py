"""Figures 1 to 3: the torque-free body of Sect. 5.1."""

from .printed import BAUMGARTE, classical, sound
from .spec import Panel, PaperFigure, Pick, Says, Sketch

BODY, SECTION, T_END = "torque_free_body", "Sect. 5.1", 300.0
OMEGA = ("obs_Omega_x", "obs_Omega_y", "obs_Omega_z")
LABELS = (r"$\Omega_x$", r"$\Omega_y$", r"$\Omega_z$")
AXIS, ENERGY = r"$\Omega$ [rad/s]", r"$E$ [J]"
TOLERANCES = (1e-3, 1e-4, 1e-5)
UNKNOWN = "the three tolerances are not printed; 1e-3, 1e-4 and 1e-5 are taken"

ONE_STEP = sound(BODY, "gc_weak_form", "ODE-GC one step", dt=T_END, t_end=T_END)
STEPS = sound(BODY, "gc_weak_form", "ODE-GC", dt=0.1, t_end=T_END)


def _three(name: str) -> tuple[Pick, ...]:
    return tuple(classical(BODY, name, tol, 0.1, t_end=T_END) for tol in TOLERANCES)


def _two(solver: str) -> tuple[Pick, ...]:
    return tuple(sound(BODY, solver, f"{solver} {tol:g}", rtol=tol, t_end=T_END) for tol in (1e-6, 1e-8))


def _first(variant: str, picks: tuple[Pick, ...], says: tuple[Says, ...]) -> PaperFigure:
    return PaperFigure(
        1, variant, SECTION, "Torque-free motion: the body, its angular velocity and its energy",
        (*picks, STEPS, ONE_STEP),
        (
            (Sketch("the body", "rods", width=4),
             Panel("angular velocity", OMEGA, AXIS, (0.0, 50.0), labels=LABELS, width=8)),
            (Panel("mechanical energy", ("energy",), ENERGY, (0.0, 50.0), width=12),),
        ),
        says, (UNKNOWN,) if variant == "as printed" else (),
    )  # fmt: skip


def _dae(number: int, variant: str, name: str, picks: tuple[Pick, ...], says: tuple[Says, ...]) -> PaperFigure:
    return PaperFigure(
        number, variant, SECTION, f"Torque-free motion with {name}: angular velocity and energy", (*picks, STEPS),
        (
            (Panel("angular velocity", OMEGA, AXIS, (0.0, T_END), labels=LABELS, width=8),
             Panel("", OMEGA, AXIS, (290.0, T_END), continued=True, width=4)),
            (Panel("mechanical energy", ("energy",), ENERGY, (0.0, T_END), width=12),),
        ),
        says, (UNKNOWN, BAUMGARTE) if variant == "as printed" else (), height=2.1,
    )  # fmt: skip


_AXIS_KEPT = Says("one step, independently of the duration", "axis", ("ODE-GC one step", "ODE-GC"))
_CONVERGES = Says(
    "the numerical solution converges to the exact motion", "axis", tuple(p.key for p in _three("ODE-45"))
)
_FI, _SE = (tuple(p.key for p in _three(name)) for name in ("DAE-FI", "DAE-SE"))

FIGURES = (
    _first("as printed", _three("ODE-45"), (_AXIS_KEPT, _CONVERGES)),
    _first("recommended", _two("rk45_strong_form"), (_AXIS_KEPT,)),
    _dae(2, "as printed", "DAE-FI", _three("DAE-FI"), (
        Says("energy levels about two orders of magnitude larger", "energy", _FI[:1]),
        Says("the integration fails at about 72 s", "end", _FI[1:2], fails_at=72.0),
        Says("a pure rotation about an axis different from the original", "axis", _FI[2:]),
    )),
    _dae(2, "recommended", "DAE-FI", _two("ida_index1"),
         (Says("deviation cannot be eliminated by tolerance", "axis"),)),
    _dae(3, "as printed", "DAE-SE", _three("DAE-SE"), (
        Says("no evidence of converging to a pure rotation", "axis", _SE),
        Says("large oscillations of the mechanical energy", "energy", _SE),
    )),
    _dae(3, "recommended", "DAE-SE", _two("ndf_index1"),
         (Says("no evidence of converging to a pure rotation", "axis"),)),
)  # fmt: skip
