"""The command `hypermask`."""
