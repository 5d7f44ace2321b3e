"""Peers of real drivers: what a driver talks to, emulated to the byte or to the call."""
