"""List the ways in which a solver can be presented with the same problem in another form.

Each is a parameter of every problem (``catalogue.registry``). The changes of ``mechanics.presentation`` are undone
before a motion is measured; a motion that is turned in space is measured as it is.
"""

from typing import Any, NamedTuple


class PresentationParameter(NamedTuple):
    """A parameter that changes how a problem is presented, with the words that checks and pages use for it."""

    name: str
    check: str  # the symmetry of a solver that it shows
    words: str  # of a problem that is presented so
    tried: Any  # the value by which ``try`` asks a solver for the symmetry
    undone: bool = True


PRESENTATIONS = (
    PresentationParameter("retrace", "time reversal", "run backwards from the end", True),
    PresentationParameter("yaw", "yaw", "turned about the vertical", 0.7, undone=False),
    PresentationParameter("rotation", "rotation", "turned in space", (0.3, -0.5, 0.7), undone=False),
    PresentationParameter("mirror", "mirror image", "as a mirror image", "X"),
    PresentationParameter("renumber", "renumbering", "with bodies and joints renumbered", 1),
    # powers of two, which round no number
    PresentationParameter("unit_length", "unit of length", "in another unit of length", 1024.0),
    PresentationParameter("unit_mass", "unit of mass", "in another unit of mass", 1024.0),
    PresentationParameter("unit_time", "unit of time", "in another unit of time", 8.0),
    PresentationParameter("duplicate", "repeated joint", "with a joint declared twice", 1),
)
