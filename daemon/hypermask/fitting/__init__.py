"""The fitting tool's engine: a photograph's mesh corrected by dragging its points (PAPERS A3)."""
