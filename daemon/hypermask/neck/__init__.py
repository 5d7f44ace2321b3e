"""The head's movements: what the show asks for, and trajectories that a neck can follow."""
