"""Rehearsals: the whole show on a simulated cart, in lock-step or against the real clock."""
