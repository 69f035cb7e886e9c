"""Numbers with derivatives, with which a declared row also yields its wrench and the rate of the wrench.

A ``Jet`` holds x(t, e) to first order in t and in e, mixed term included: its value x, its ``rate`` dx/dt along the
motion, its ``slopes`` dx/de by the velocities e of the bodies, and ``slope_rates`` d2x/(dt de).
"""

from typing import Any

import numpy as np


class Jet:
    """A number with its derivatives, for the operations that declarations use (``mechanics.declaring``)."""

    __slots__ = ("rate", "slope_rates", "slopes", "x")

    def __init__(self, x: float, rate: float = 0.0, slopes: Any = 0.0, slope_rates: Any = 0.0) -> None:
        self.x, self.rate, self.slopes, self.slope_rates = x, rate, slopes, slope_rates

    def __neg__(self) -> "Jet":
        return Jet(-self.x, -self.rate, -self.slopes, -self.slope_rates)

    def __add__(self, other: Any) -> "Jet":
        """Return the sum; arrays are left to NumPy, which then adds entry by entry."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        b = jet(other)
        return Jet(self.x + b.x, self.rate + b.rate, self.slopes + b.slopes, self.slope_rates + b.slope_rates)

    def __sub__(self, other: Any) -> "Jet":
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self + -jet(other)

    def __rsub__(self, other: Any) -> "Jet":
        if isinstance(other, np.ndarray):
            return NotImplemented
        return jet(other) + -self

    def __mul__(self, other: Any) -> "Jet":
        """Return the product, with derivatives by the product rule."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        a, b = self, jet(other)
        mixed = a.slope_rates * b.x + a.slopes * b.rate + a.rate * b.slopes + a.x * b.slope_rates
        return Jet(a.x * b.x, a.rate * b.x + a.x * b.rate, a.slopes * b.x + a.x * b.slopes, mixed)

    def __truediv__(self, other: Any) -> "Jet":
        """Return the quotient, as the product with the reciprocal."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        b = jet(other)
        return self * b.apply_function(1.0 / b.x, -1.0 / b.x**2, 2.0 / b.x**3)

    def __rtruediv__(self, other: Any) -> "Jet":
        if isinstance(other, np.ndarray):
            return NotImplemented
        return jet(other) / self

    __radd__, __rmul__ = __add__, __mul__

    def apply_function(self, f: float, df: float, ddf: float) -> "Jet":
        """Return f(self) by the chain rule, from the values of f and its first two derivatives ``df``, ``ddf`` at x."""
        mixed = df * self.slope_rates + ddf * self.rate * self.slopes
        return Jet(f, df * self.rate, df * self.slopes, mixed)

    def sin(self) -> "Jet":
        """Return the sine; NumPy's ``np.sin`` calls it."""
        s, c = np.sin(self.x), np.cos(self.x)
        return self.apply_function(s, c, -s)

    def cos(self) -> "Jet":
        """Return the cosine; NumPy's ``np.cos`` calls it."""
        s, c = np.sin(self.x), np.cos(self.x)
        return self.apply_function(c, -s, -c)

    def sqrt(self) -> "Jet":
        """Return the square root; NumPy's ``np.sqrt`` calls it."""
        root = np.sqrt(self.x)
        return self.apply_function(root, 0.5 / root, -0.25 / root**3)

    def arctan2(self, other: Any) -> "Jet":
        """Return the angle of the point (x, y) = (other, self), for ``np.arctan2(self, other)``.

        Its differential is (x dy - y dx) / (x^2 + y^2).
        """
        y, x = self, jet(other)
        square = x.x**2 + y.x**2
        slopes, rate = x.x * y.slopes - y.x * x.slopes, x.x * y.rate - y.x * x.rate
        mixed = x.rate * y.slopes + x.x * y.slope_rates - y.rate * x.slopes - y.x * x.slope_rates
        mixed = mixed / square - slopes * 2.0 * (x.x * x.rate + y.x * y.rate) / square**2
        return Jet(float(np.arctan2(y.x, x.x)), rate / square, slopes / square, mixed)


def jet(x: Any) -> Jet:
    """Return ``x`` as a jet; a plain number is constant."""
    return x if isinstance(x, Jet) else Jet(float(x))
