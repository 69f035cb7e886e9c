"""Compare ensembles: the motions that a solver computes from many starts, against the true motions."""
