"""The actor's voice on its way to the loudspeaker, which never touches Python.

ALSA shares the microphone between the analysis and `alsaloop` (alsa-utils), which carries the voice
through a gate, notches and a limiter (swh-plugins) to the loudspeaker, late enough for the mouth.
This package writes their configuration from the machine's settings and says how far sound and mouth
lie apart.
"""
