"""What the exact motion keeps: energy, constraints, invariants; and the step with which it was tried."""

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from ...model.curves import Curve
from ...model.motion import Motion
from ..drawing import MUTED, Drawn, new_figure, panel_title
from .lines import Group, draw_lines, legend_of, log_limits


@dataclass(frozen=True)
class Panel:
    """A logarithmic panel over time."""

    title: str
    axis: str
    of: Callable[[Motion], Curve | None]
    scale: float  # of the problem, in the panel's unit: limits the axis


def laws(name: str, title: str, group: Group, everyone: Group) -> Drawn:
    """Energy error, |phi|, |phi_dot| and step over time; axes as high as ``everyone`` on this problem needs."""
    energy, length = _scale(everyone, "energy_scale_J"), _scale(everyone, "length_scale_m")
    panels = [
        Panel("Energy error", r"$|E-E_0|$ [J]", norm("energy_error"), energy),
        Panel("Constraints", r"$\|\phi\|$ [m]", norm("phi_norm"), length),
        Panel("Constraint rates", r"$\|\dot\phi\|$ [m/s]", norm("phi_dot_norm"), length),
        Panel("Step", r"$\Delta t$ [s]", lambda m: m.step, group.t_end),
    ]
    caption = (
        "Largest magnitude in each of 240 spans of time, so that peaks stay; the step as median line in a band "
        "from its smallest to its largest. Axis rows of phi have no unit and count as metres."
    )
    return Drawn(name, title, caption, lambda: grid_of(panels, group, everyone))


def grid_of(panels: list[Panel], group: Group, everyone: Group, decorate: Callable | None = None) -> Figure:
    """Panels two abreast with one legend."""
    abreast = len(panels) if len(panels) in (1, 3) else 2
    rows = -(-len(panels) // abreast)
    legend = legend_of(group)
    figure = new_figure(1.95 * rows + 0.2 + legend.height)
    axes = figure.subplots(rows, abreast, sharex=True, squeeze=False).ravel()
    for k, (ax, panel) in enumerate(zip(axes, panels, strict=False)):
        own, all_of_it = ([panel.of(m) for m in g.motions] for g in (group, everyone))
        limits = log_limits(own, panel.scale)[0], log_limits(all_of_it, panel.scale)[1]
        draw_lines(ax, group, panel.of, limits, log=True)
        if any(c is not None and len(c) for c in own) and not any(c is not None and c.y.any() for c in own):
            ax.text(0.5, 0.5, "exactly zero throughout", transform=ax.transAxes, ha="center", color=MUTED)
        if decorate:
            decorate(ax, panel)
        panel_title(ax, k, panel.title)
        ax.set_ylabel(panel.axis)
        if k >= len(panels) - abreast:
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(r"$t$ [s]")
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    legend.put(figure)
    return figure


def norm(name: str) -> Callable[[Motion], Curve | None]:
    """The curve of that name, where a motion has it."""
    return lambda m: m.norms.get(name)


def _scale(group: Group, column: str) -> float:
    values = [getattr(c.record, column) for c in group.runs]
    return max((v for v in values if v == v), default=1.0)
