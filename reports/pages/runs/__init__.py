"""Write the pages of runs: first page, problems, solvers, each run, theatre, failures, the paper's figures."""
