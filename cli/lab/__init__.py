"""Define the commands of the lab."""
