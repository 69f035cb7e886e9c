"""Figures 10 and 11: the spinning top of Sect. 5.4 in cuspidal motion."""

from .printed import BAUMGARTE, CHART, STARTS, classical, geometric, sound
from .spec import Panel, PaperFigure, Says, Sketch

TOP, SECTION, ALL = "heavy_top", "Sect. 5.4", (0.0, 5.0)
PRINTED = (*geometric(TOP, 1e-3, 1e-4), *(classical(TOP, n, 1e-4, 1e-3) for n in ("ODE-45", "DAE-FI", "DAE-SE")))
SOUND = (
    sound(TOP, "gc_weak_form", dt=1e-3),
    *(sound(TOP, n, rtol=1e-8) for n in ("rk45_strong_form", "ida_index1", "ndf_index1", "ida_index3")),
)
TITLE = "Spinning top in cuspidal motion: nutation, precession rate, step and energy"
ROWS = (
    (Panel("nutation angle", ("obs_theta",), r"$\theta$ [deg]", ALL, exact="ref_theta"),
     Panel("precession rate", ("obs_phi_dot",), r"$\dot\varphi$ [rad/s]", ALL, exact="ref_phi_dot")),
    (Panel("step", ("dt",), r"$\Delta t$ [s]", ALL, log=True),
     Panel("mechanical energy", ("energy",), r"$E$ [J]", ALL)),
)  # fmt: skip
_45, _FI, _SE = (p.key for p in PRINTED[2:])

FIGURES = (
    PaperFigure(10, "as printed", SECTION, "The spinning top", SOUND[:1],
                ((Sketch("", "top", width=12),),), height=2.3),
    PaperFigure(11, "as printed", SECTION, TITLE, PRINTED, ROWS, (
        Says("both ODE solvers virtually coincide with the analytical results", "away", ("ODE-GC", "ODE-GC 2", _45),
             series="obs_theta"),
        Says("ODE-45 pays with a large decrease of the step", "step", (_45,)),
        Says("DAE-FI acceptable for a short interval, then fails suddenly", "end", (_FI,), fails_at=float("nan")),
        Says("DAE-SE runs throughout, but inaccurate", "end", (_SE,), runs=True),
        Says("DAE-SE inaccurate", "away", (_SE, _FI), series="obs_theta"),
        Says("its step varies by about four orders of magnitude", "step", (_SE,)),
        Says("the energy shows the same", "largest", series="energy_error"),
    ), (BAUMGARTE, CHART, STARTS, "when DAE-FI fails is not printed")),
    PaperFigure(11, "recommended", SECTION, TITLE, SOUND, ROWS, (
        Says("", "away", series="obs_theta"), Says("", "largest", series="energy_error"), Says("", "step"))),
)  # fmt: skip
