"""Define runs to make: a problem, a solver and a setting, one by one or as products listed in a TOML file."""
