"""Describe a shadow and a modified energy as findings."""

import numpy as np

from ...judge.distance import GAP
from ...mechanics.types import ACCURATE
from ...results.findings import Finding, judge_value, state_finding
from ...results.shadows import SYMPLECTIC, NearestMotion
from .modified_energy import ModifiedEnergy
from .shadow import Shadow


def describe_shadow(s: Shadow) -> list[Finding]:
    """Return findings on a shadow: over which time a true motion was found, how near it is, and how it starts.

    Without a shadow only the first three, which are judged, and plain counts are returned.
    """
    C = s.distance
    at = f"at {s.t[int(np.argmax(np.max(C, axis=1)))]:.6g} s"
    most = ACCURATE["accurate_until_s"] * s.reach
    start = float(np.max(np.linalg.norm(s.given.v[0] - s.true.v[0], axis=1)))
    numbers = (
        ("rms distance of C", np.sqrt(np.mean(C**2)), "m"),
        ("largest distance of a body's matter", np.max(s.matter), "m"),
        ("rms distance of the matter", np.sqrt(np.mean(s.matter**2)), "m"),
        ("distance of the starts", np.max(C[0]), "m"),
        ("difference of velocities at the start", start, "m/s"),
        ("energy of the shadow less that of the start", s.energy_shift, "J"),
        ("metric: time that weighs velocities", s.tau, "s"),
        ("segments", len(s.t) - 1, ""),
        ("iterations", s.iterations, ""),
        ("CPU time", s.cpu_s, "s"),
    )
    return [
        state_finding("true motion nearby", describe_extent(s), f"over {s.t_end:.6g} s", s.is_complete),
        judge_value(s.gap, "m", most=GAP, quantity="largest gap left"),
        judge_value(float(np.max(C)), "m", most=most, words=at, quantity="largest distance of C", tested=s.until > 0.0),
        *(Finding(name, float(value), unit) for name, value, unit in numbers if s.until > 0.0 or not unit),
    ]


def summarise_shadow(s: Shadow) -> dict[str, str | float]:
    """Return a sentence on a shadow (``words``) and its numbers by name: ``until_s``, ``largest_m``, ``rms_m`` ..."""
    largest, rms = float(np.max(s.distance)), float(np.sqrt(np.mean(s.distance**2)))
    numbers = {"until_s": s.until, "largest_m": largest, "rms_m": rms, "gap_m": s.gap, "glitch_s": s.glitch}
    if not s.until > 0.0:
        return {"words": f"none found near it: {describe_extent(s)}", **numbers}
    over = f"over {s.until:.4g} s" + ("" if s.is_complete else f" of {s.t_end:.4g} s; a glitch near {s.glitch:.4g} s")
    return {"words": f"one within {1e3 * largest:.3g} mm, rms {1e3 * rms:.3g} mm, {over}", **numbers}


def summarise_nearest(s: Shadow, m: ModifiedEnergy | None) -> NearestMotion:
    """Return the numbers on shadow and modified energy that are stored with a run; None for those that do not exist."""
    swing = None if m is None else m.energy_range / m.scale
    if not s.until > 0.0:
        return NearestMotion(modified_energy=swing)
    C = s.distance
    return NearestMotion(s.until, float(np.max(C)), float(np.sqrt(np.mean(C**2))), swing)


def describe_extent(s: Shadow) -> str:
    """Return in words over which time a shadow was found, and where the first glitch is."""
    where = f"{s.until:.6g} s{', in the plane' * s.in_plane}" if s.until > 0.0 else "no time"
    return f"found over {where}" if s.is_complete else f"found over {where}; a glitch near {s.glitch:.4g} s"


def describe_energy(m: ModifiedEnergy) -> list[Finding]:
    """Return findings on a modified energy: its range as a fraction of the energy scale, and the verdict from that.

    The verdict is ``symplectic: yes`` where the range is below ``SYMPLECTIC`` of the scale.
    """
    name = f"swing of the modified energy, differences of order {m.order}"
    swing, shown = m.energy_range / m.scale, NearestMotion(modified_energy=m.energy_range / m.scale).symplectic
    words = f"symplectic: {shown}"
    return [
        judge_value(swing, "of the scale", most=SYMPLECTIC, words=words, quantity=name, tested=shown == "yes"),
        Finding("swing of the energy", float(np.ptp(m.energy)) / m.scale, "of the scale"),
    ]
