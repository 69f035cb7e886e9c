"""The step of ODE-GC by a simplified Newton method on S = A M^-1 A^T; its first module is ``step``."""
