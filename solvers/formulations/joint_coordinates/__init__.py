"""Straight code of a mechanism in the coordinates of its joints: a spanning tree, its loops closed by rows."""
