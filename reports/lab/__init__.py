"""Draw what commands of the lab have just computed."""
