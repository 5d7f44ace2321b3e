"""Builds the disk: a Debian 13 root file system with what the drivers need, once for each recipe.

Run as root: ``python -m hypermask_sim.appliance.image build/appliance``. Needs the Debian packages
mmdebstrap and e2fsprogs; takes some minutes. The kernel and its initial RAM disk lie beside the
disk, so no boot loader is needed.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hypermask_drivers.errors import HypermaskError
from hypermask_sim.appliance import guest

SUITE = "trixie"
DISK_SIZE = "4G"
PACKAGES = (
    # the system
    "linux-image-amd64", "init", "systemd", "udev", "kmod", "dbus", "procps", "iproute2",
    # what the drivers stand on
    "python3", "python3-numpy", "python3-opencv", "python3-moderngl", "python3-pydantic",
    "libegl1", "libgles2", "libgbm1", "libdrm2", "libgl1-mesa-dri",
    # to look from outside at what the drivers do
    "v4l-utils",
)  # fmt: skip

_UNIT = """\
[Unit]
Description=Commands from the host
DefaultDependencies=no
After=systemd-udevd.service local-fs.target
Wants=systemd-udev-trigger.service

[Service]
ExecStart=/usr/bin/python3 -u /usr/local/lib/hypermask-agent.py
Restart=always
RestartSec=1

[Install]
WantedBy=multi-user.target
"""

_FSTAB = """\
/dev/vda / ext4 rw,errors=remount-ro 0 1
host /host 9p trans=virtio,version=9p2000.L,msize=262144,nofail 0 0
source /source 9p trans=virtio,version=9p2000.L,msize=262144,ro,nofail 0 0
"""


@dataclass(frozen=True)
class Image:
    """Files of a built disk: raw ext4 without partitions, kernel, initial RAM disk."""

    disk: Path
    kernel: Path
    initrd: Path

    @classmethod
    def in_folder(cls, folder: Path) -> Image:
        return cls(folder / "disk.img", folder / "vmlinuz", folder / "initrd.img")


def recipe(packages: Sequence[str] = PACKAGES) -> str:
    """A name for what goes into the disk; another recipe needs another disk."""
    parts = [SUITE, DISK_SIZE, _UNIT, _FSTAB, Path(guest.__file__).read_text("utf-8"), *packages]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def build(folder: Path, packages: Sequence[str] = PACKAGES) -> Image:
    """The disk of this recipe in `folder`; built only when it is not there yet.

    Raises `HypermaskError` APL-ROOT, APL-TOOL or APL-BUILD.
    """
    image, mark = Image.in_folder(folder), folder / "recipe"
    if mark.exists() and mark.read_text("utf-8") == recipe(packages) and image.disk.exists():
        return image
    _check_tools()
    folder.mkdir(parents=True, exist_ok=True)
    mark.unlink(missing_ok=True)
    root = folder / "root"
    shutil.rmtree(root, ignore_errors=True)
    _run(
        "mmdebstrap", "--variant=minbase", f"--include={','.join(packages)}",
        "--dpkgopt=path-exclude=/usr/share/doc/*", "--dpkgopt=path-exclude=/usr/share/man/*",
        "--dpkgopt=path-exclude=/usr/share/locale/*", '--aptopt=Apt::Install-Recommends "false"',
        SUITE, str(root),
    )  # fmt: skip
    _furnish(root)
    for name, target in (("vmlinuz", image.kernel), ("initrd.img", image.initrd)):
        shutil.copyfile(
            (root / name).resolve() if (root / name).exists() else _boot(root, name), target
        )
    image.disk.unlink(missing_ok=True)
    _run("mkfs.ext4", "-q", "-L", "hypermask", "-d", str(root), str(image.disk), DISK_SIZE)
    shutil.rmtree(root)
    mark.write_text(recipe(packages), "utf-8")
    return image


def _boot(root: Path, name: str) -> Path:
    """The newest kernel file; the links in / are absolute in some versions."""
    return sorted((root / "boot").glob(f"{name}-*"))[-1]


def _furnish(root: Path) -> None:
    agent = root / "usr/local/lib/hypermask-agent.py"
    agent.write_text(Path(guest.__file__).read_text("utf-8"), "utf-8")
    unit = root / "etc/systemd/system/hypermask-agent.service"
    unit.write_text(_UNIT, "utf-8")
    wants = root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True, exist_ok=True)
    (wants / unit.name).symlink_to(f"/etc/systemd/system/{unit.name}")
    (root / "etc/fstab").write_text(_FSTAB, "utf-8")
    (root / "etc/hostname").write_text("cart\n", "utf-8")
    for folder in ("host", "source"):
        (root / folder).mkdir(exist_ok=True)


def _check_tools() -> None:
    if os.geteuid() != 0:
        raise HypermaskError(
            "APL-ROOT", "building the disk needs the rights of root", "Run it as root."
        )
    missing = [tool for tool in ("mmdebstrap", "mkfs.ext4") if shutil.which(tool) is None]
    if missing:
        raise HypermaskError(
            "APL-TOOL",
            f"the disk cannot be built without {' and '.join(missing)}",
            "Install the packages mmdebstrap and e2fsprogs.",
        )


def _run(*command: str) -> None:
    result = subprocess.run(
        ["nice", "-n", "15", *command], stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True
    )
    if result.returncode:
        last = "; ".join(result.stdout.strip().splitlines()[-3:])
        raise HypermaskError(
            "APL-BUILD", f"{command[0]} failed: {last}", "Check the network and the free space."
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the disk of the virtual cart.")
    parser.add_argument("folder", type=Path)
    print(build(parser.parse_args().folder).disk)


if __name__ == "__main__":
    main()
