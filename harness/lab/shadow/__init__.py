"""Find the true motion nearest to a computed one, and the modified energy of a fixed-step method from a trajectory."""
