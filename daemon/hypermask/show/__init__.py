"""The show: cues, the key map, and the engine that turns key presses into a scene."""
