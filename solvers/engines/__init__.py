"""Solvers that run external engines: one file each; ``export`` converts models, ``inside`` drives the engines."""
