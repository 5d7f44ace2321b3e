"""The face: mesh on the mask, expressions, mouth, lids, characters on disk (PAPERS A3 to A5)."""
