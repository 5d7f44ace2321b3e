"""Peers of the real drivers, which speak their hardware's language."""
