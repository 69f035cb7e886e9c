"""Execute runs: processes, workers, a pool or a cluster, and what they hand over to be measured."""
