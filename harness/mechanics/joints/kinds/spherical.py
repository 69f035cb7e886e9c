"""Spherical joint: two points coincide."""

from ...declaring import Count, JointDeclaration, gap

KIND = JointDeclaration("spherical", 0, Count(point=3), leaves="all rotation", equation="d = 0", phi=gap)
