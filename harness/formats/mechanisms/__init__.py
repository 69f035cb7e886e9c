"""Read mechanisms of other programs: MJCF, URDF, SDFormat, USD, SymPy."""
