"""Figure 12: the grid of four-bar linkages of Sect. 5.5."""

from .printed import sound
from .spec import Panel, PaperFigure, Pick, Says, Sketch

GRID, SECTION, ALL = "four_bar_grid", "Sect. 5.5", (0.0, 10.0)
NESTED = {"gauge": "accumulate", "sigma0": "carried", "tolerance": 1e-3, "loop": "nested", "penalty": 1e3}
PRINTED = (Pick("ODE-GC", "gc_augmented_lagrangian", GRID, {}, NESTED, dt=0.01, words="nested loop"),)
SOUND = (
    sound(GRID, "gc_augmented_lagrangian", dt=0.01),
    *(sound(GRID, n, rtol=1e-8) for n in ("rk45_strong_form", "ida_index1", "ndf_index1")),
    sound(GRID, "ida_index3", rtol=1e-6),
)
TITLE = "Grid of four-bar linkages: start, energy, first row, a bottom joint"
ROWS = (
    (Sketch("initial position", "grid"),
     Panel("mechanical energy", ("energy",), r"$E$ [J]", ALL, band=True)),
    (Panel("first row, angular position", ("obs_angle_1",), r"$\varphi_1$ [rad]", ALL, exact="ref_angle_1"),
     Panel("first row, angular velocity", ("obs_rate_1",), r"$\dot\varphi_1$ [rad/s]", ALL, exact="ref_rate_1")),
    (Panel("joint A, Y", ("obs_bottom_left_y",), r"$Y_A$ [m]", ALL, exact="ref_bottom_left_y"),
     Panel("joint A, Z", ("obs_bottom_left_z",), r"$Z_A$ [m]", ALL, exact="ref_bottom_left_z")),
)  # fmt: skip
SAYS = (
    Says("energy drift at most 1 J", "drift"),
    Says("response virtually indistinguishable from the benchmark's", "error"),
)
NOT_PRINTED = (
    "tolerance and penalties of the augmented Lagrangian are not printed; 1e-3 and 1e3 are taken",
    "joint A cannot be told from the text: the bottom left joint is drawn",
    "the benchmark's curves are not ours to copy: the certified exact motion takes their place",
    "the negligible axial inertia is not printed: 1e-4 kg m2",
)

FIGURES = (
    PaperFigure(12, "as printed", SECTION, TITLE, (*PRINTED, SOUND[0]), ROWS, SAYS, NOT_PRINTED),
    PaperFigure(12, "recommended", SECTION, TITLE, SOUND, ROWS, SAYS, NOT_PRINTED[1:]),
)
