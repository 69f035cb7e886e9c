"""From a trajectory to numbers and a status."""
