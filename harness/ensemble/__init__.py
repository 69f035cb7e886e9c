"""Ensembles: the cloud of motions that a solver makes of many starts, against the true cloud."""
