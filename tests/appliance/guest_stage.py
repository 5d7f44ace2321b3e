"""Runs inside the guest: the stage's own renderer draws on the projector."""

import faulthandler
import sys
import time
from pathlib import Path

sys.path.insert(0, "/source/drivers")
sys.path.insert(0, "/source/daemon")
from stage_picture import draw_mask

from hypermask_drivers.projector.kms import KmsProjector
from hypermask_drivers.projector.kms_settings import KmsSettings

faulthandler.enable()
faulthandler.dump_traceback_later(120)
with KmsProjector(KmsSettings(mode="1280x800")) as projector:
    draw_mask(projector, Path("/source"))
    projector.present()
    Path("/host/stage.reached").touch()
    while not Path("/host/stage.seen").exists():
        time.sleep(0.1)
