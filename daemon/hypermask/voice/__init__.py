"""The actor's voice becomes thirteen mouth parameters."""
