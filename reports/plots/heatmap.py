"""The first picture of a report for print: solvers by problems, coloured by the largest error over its limit."""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..model.accuracy import LEVELS
from ..model.heat import Heat
from .style import DOUBLE, INK, MUTED, PAPER, plain, sheet

COLOURS = ("#86bde0", "#acd1ea", "#cde3f2", "#e4f0f7", "#f7f6f1", "#ffe2ac", "#f8a66a", "#b3123a")  # as in site.css
ROW, HEAD = 0.25, 0.75  # [in]
SIGNS = {"good": "", "inaccurate": "≈ ", "wrong": "× ", "failed": "★ ", "open": "not finished", "refused": "refused"}


def heat_figure(heat: Heat) -> Figure:
    """One row a solver, one column a problem; the number is the margin."""
    out = sheet(DOUBLE, ROW * len(heat.rows) + HEAD)
    ax = out.add_subplot()
    for y, row in enumerate(heat.rows):
        for x, box in enumerate(row.boxes):
            colour = PAPER if box is None else "#ece9e6" if box.level is None else COLOURS[box.level]
            ax.add_patch(Rectangle((x, y), 1.0, 1.0, facecolor=colour, edgecolor=PAPER, linewidth=1.0))
            if box is not None:
                loud = box.level == len(LEVELS)
                words = plain(f"{SIGNS[box.mark.kind]}{box.text}")
                ax.text(x + 0.5, y + 0.53, words, ha="center", va="center", fontsize=7, color=PAPER if loud else INK)
    ax.set(xlim=(0, len(heat.problems)), ylim=(len(heat.rows), 0))
    columns, rows = (np.arange(len(of)) + 0.5 for of in (heat.problems, heat.rows))
    ax.set_xticks(columns, [_title(p.problem, p.parameters) for p in heat.problems])
    names = ["\n".join(plain(k) for k in (row.solver, row.paper_label) if k) for row in heat.rows]
    ax.set_yticks(rows, names, fontsize=7)
    ax.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
    ax.spines[:].set_visible(False)
    ax.grid(visible=False)
    edges = [*(f"≤ {edge:g}" for edge in LEVELS), "more"]
    keys = [Patch(facecolor=c, edgecolor=MUTED, linewidth=0.4, label=e) for c, e in zip(COLOURS, edges, strict=True)]
    out.legend(handles=keys, loc="outside lower center", ncols=len(keys), title="error / limit", handlelength=1.0)
    return out


def _title(problem: str, parameters: str) -> str:
    words = [plain(problem.replace("_", " ")), *([plain(parameters)] if parameters else [])]
    return "\n".join(w if len(w) <= 14 else w.replace(" ", "\n", math.ceil(len(w) / 14) - 1) for w in words)
