"""Hardware behind small interfaces. Knows nothing of the show."""
