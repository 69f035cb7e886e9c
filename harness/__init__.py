"""Run problems through solvers, measure the motions and judge them."""
