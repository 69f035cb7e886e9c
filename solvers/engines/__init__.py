"""Engines of others as solvers: one public file each; what they share is in ``export``."""
