"""Distance from the exact motion: position, orientation, and out of the plane where the motion is planar."""

from matplotlib.axes import Axes

from reports.accuracy import judged_until
from reports.drawing import MUTED, Drawn
from reports.figures.laws import Panel, grid_of, norm
from reports.figures.lines import Group

NAMES = (
    ("position_error", "Position, worst body", r"$|r - r_\mathrm{exact}|$ [m]"),
    ("orientation_error", "Orientation, worst body", r"$\angle(R, R_\mathrm{exact})$ [rad]"),
    ("out_of_plane", "Out of the plane", "distance [m]"),
)


def errors(name: str, title: str, group: Group, everyone: Group) -> Drawn | None:
    """Errors over time; what is below the reference's own error is shaded. None when no cell has one."""
    length = max((c.record.length_scale_m for c in everyone.cells if c.record.length_scale_m > 0.0), default=1.0)
    scales = {"position_error": length, "orientation_error": 1.0, "out_of_plane": length}
    panels = [
        Panel(head, axis, norm(key), scales[key])
        for key, head, axis in NAMES
        if any(len(m.norms.get(key, ())) for m in everyone.motions)
    ]
    if not panels:
        return None
    own = max(
        (m for m in everyone.motions if m.own_error is not None), key=lambda m: len(m.own_error or ()), default=None
    )

    until = judged_until(everyone.cells)

    def shade(ax: Axes, panel: Panel) -> None:
        if panel.axis == NAMES[2][2]:  # the plane needs no reference
            return
        low, high = ax.get_ylim()
        if own is not None and own.own_error is not None and panel.axis == NAMES[0][2]:
            edge = own.own_error.y.clip(low, high)
            ax.fill_between(own.own_error.t, low, edge, color=MUTED, alpha=0.18, linewidth=0)
        if until is not None:
            ax.axvline(until, color=MUTED, linewidth=0.9, linestyle=(0, (1, 2)))

    caption = "Largest in each span of time, up to the reference's horizon. Shaded: below the reference's own error."
    if until is not None:
        caption += " Dotted: up to here errors are judged; beyond, the motion is chaotic."
    return Drawn(name, title, caption, lambda: grid_of(panels, group, everyone, shade))
