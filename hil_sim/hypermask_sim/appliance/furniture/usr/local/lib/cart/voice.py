"""Plays /host/voice.wav into the loopback sound card, again and again: the actor speaks."""

import subprocess
import time
from pathlib import Path

SPOKEN = Path("/host/voice.wav")
CARD = "hw:Loopback,0,0"


def main() -> None:
    while not SPOKEN.exists():
        time.sleep(1)
    while True:
        if subprocess.run(["aplay", "-q", "-D", CARD, str(SPOKEN)]).returncode:
            time.sleep(1)


if __name__ == "__main__":
    main()
