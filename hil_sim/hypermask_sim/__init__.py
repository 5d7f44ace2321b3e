"""The simulated cart: the drivers' interfaces, driven by a scenario file."""
