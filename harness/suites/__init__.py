"""Runs to make: a problem, a solver and a setting, one by one or as the products that a TOML file lists."""
