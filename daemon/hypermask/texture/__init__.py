"""A photograph becomes a character: landmarks, fit, normalised texture (PAPERS B)."""
