"""Define the command that judges motions of other programs."""
