"""The paper's claims as data, each tried over a map of settings."""
