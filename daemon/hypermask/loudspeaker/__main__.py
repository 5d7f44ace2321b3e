"""`python -m hypermask.loudspeaker --machine FILE --out FOLDER`: writes the sound configuration.

`--configured` takes the tables [microphone] and [loudspeaker] of the machine that is configured.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hypermask.errors import HypermaskError
from hypermask.loudspeaker.configuration import write
from hypermask.loudspeaker.settings import SoundSettings, load_sound


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="hypermask.loudspeaker", description=__doc__)
    parser.add_argument("--machine", type=Path, help="TOML file with a table [sound]")
    parser.add_argument("--configured", action="store_true", help="what this machine has")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    options = parser.parse_args(arguments)
    try:
        sound = load_sound(options.machine) if options.machine else SoundSettings()
        if options.configured:
            sound = _configured()
        for path in write(sound, options.out):
            print(path)
    except HypermaskError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def _configured() -> SoundSettings:
    """Raises `ConfigError` CFG-*."""
    from hypermask.machine.files import load

    machine = load().machine
    return SoundSettings(microphone=machine.microphone, loudspeaker=machine.loudspeaker)


if __name__ == "__main__":
    sys.exit(main())
