"""Execute runs: processes, workers, a pool or a cluster, and the measuring of what the solvers return."""
