"""Describe mechanisms to programs with joint coordinates, engines and files: a tree with cut joints, as numbers."""
