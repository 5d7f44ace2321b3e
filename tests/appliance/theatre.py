"""A machine that the steps of a file share, with a show that plays at the begin of each."""

from __future__ import annotations

from pathlib import Path

from virtual_show import PLACE, VirtualShow

from hypermask_sim.appliance.image import Image as Disk

BOOT_S = 400.0
"""Guest time until there must be a face."""


class Theatre:
    """The machine that the steps of a file share."""

    def __init__(self, disk: Disk, work: Path) -> None:
        self._disk, self._work = disk, work
        self.show: VirtualShow | None = None
        self.plays = False

    def switch_on(self) -> VirtualShow:
        self.close()
        self.show = VirtualShow(self._disk, self._work, keep_disk=True)
        return self.show

    def playing(self) -> VirtualShow:
        """A show with a face: the one that runs, or one on a machine that is started anew."""
        if self.show is not None and self.plays:
            return self.show
        show = self.switch_on()
        show.cart.wait_booted(3600)
        show.shows(PLACE, guest_s=BOOT_S)
        return show

    def close(self) -> None:
        if self.show is not None:
            self.show.close()
        self.show = None
