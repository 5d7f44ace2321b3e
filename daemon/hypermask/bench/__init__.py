"""Measurements behind `hypermask bench`; `make bench` writes them into docs/benchmarks.md."""
