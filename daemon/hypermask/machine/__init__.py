"""The machine: which devices the cart has and how its workers run, from a few layers of TOML."""
