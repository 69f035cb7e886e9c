"""Mechanisms in the coordinates of their joints, as straight-line code: a spanning tree, its loops closed by rows."""
