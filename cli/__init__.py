"""Define the subcommands, one file each."""
