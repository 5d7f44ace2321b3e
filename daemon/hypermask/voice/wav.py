"""The WAV reader, under the show's own name (see `hypermask_drivers.sound.wav`)."""

from hypermask_drivers.sound.wav import read_wav

__all__ = ["read_wav"]
