"""Runs it: processes, workers, a pool or a cluster, and the measuring of what they hand back."""
