"""The stage: what is on it (scene), how it is drawn on the mask (renderer), and when (pacing)."""
