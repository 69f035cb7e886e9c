"""Compare the speed of solvers: time runs in turns, and search the cheapest setting that meets an error."""
