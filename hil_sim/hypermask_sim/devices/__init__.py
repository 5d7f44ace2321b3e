"""One simulated device for each interface: a pure function of scenario, clock and its calls."""
