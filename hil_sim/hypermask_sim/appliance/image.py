"""Builds the disk: a Debian 13 with the .deb inside and the virtual cart's devices around it.

Run as root: ``python -m hypermask_sim.appliance.image build/appliance dist/*.deb``. Needs the
Debian packages mmdebstrap and e2fsprogs. The base system takes minutes and is kept by its recipe;
only the last step, the .deb into a copy of it, is made again for another .deb. Kernel and initial
RAM disk lie beside the disk, so no boot loader is needed.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hypermask_drivers.errors import HypermaskError
from hypermask_sim.appliance import guest

SUITE = "trixie"
DISK_SIZE = "4G"
SYSTEM = (
    "linux-image-amd64", "initramfs-tools", "zstd", "init", "systemd", "systemd-sysv", "udev",
    "kmod", "dbus", "apt", "login", "procps", "psmisc", "iproute2", "kbd",
)  # fmt: skip
"""What boots, with a login, as an appliance has it."""
DRIVERS = (
    "python3", "python3-numpy", "python3-opencv", "python3-moderngl", "python3-pydantic",
    "python3-typer", "python3-rich", "python3-pil", "python3-serial", "python3-smbus2",
    "python3-hid", "python3-usb", "python3-alsaaudio",
    "libegl1", "libgles2", "libgbm1", "libdrm2", "libgl1-mesa-dri",
)  # fmt: skip
"""What the program stands on; the .deb's own dependencies come on top."""
LOOKING = ("v4l-utils", "alsa-utils", "i2c-tools")
"""To play the devices and to look from outside at what the drivers do."""
PACKAGES = (*SYSTEM, *DRIVERS, *LOOKING)
FURNITURE = Path(__file__).with_name("furniture")
"""What is put over the base system, by its path in the guest."""
MACHINE = 'machine = "qemu"\n'

_MODULES = ("virtio_pci", "virtio_blk", "ext4")
_UNKEPT = ("doc", "man", "locale", "info")


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
    """A name for what the base system is made of; another recipe needs another one."""
    parts = [SUITE, *_MODULES, *_UNKEPT, *sorted(packages)]
    return _digest(part.encode() for part in parts)


def build(folder: Path, debs: Sequence[Path] = ()) -> Image:
    """The disk with `debs` installed; what is there already is not built again.

    Raises `HypermaskError` APL-ROOT, APL-TOOL or APL-BUILD.
    """
    packages = tuple(dict.fromkeys([*PACKAGES, *needed_by(debs)]))
    image, mark = Image.in_folder(folder), folder / "disk.recipe"
    contents = [path.read_bytes() for path in [*debs, *_furniture(), Path(guest.__file__)]]
    wanted = _digest([recipe(packages).encode(), DISK_SIZE.encode(), *contents])
    if _reads(mark, wanted) and image.disk.exists():
        return image
    _check_tools()
    mark.unlink(missing_ok=True)
    base = _base(folder, packages)
    root = folder / "root"
    shutil.rmtree(root, ignore_errors=True)
    _run("cp", "-a", "--reflink=auto", str(base.resolve()), str(root))
    _install(root, debs)
    _furnish(root)
    if debs:
        _prepare(root)
    for name, target in (("vmlinuz", image.kernel), ("initrd.img", image.initrd)):
        shutil.copyfile(_boot(root, name), target)
    image.disk.unlink(missing_ok=True)
    _run("mkfs.ext4", "-q", "-L", "cart", "-d", str(root), str(image.disk), DISK_SIZE)
    shutil.rmtree(root)
    mark.write_text(wanted, "utf-8")
    return image


def needed_by(debs: Sequence[Path]) -> list[str]:
    """The packages that `debs` depend on and do not bring themselves; first of alternatives."""
    fields = [_field(deb, "Depends") for deb in debs]
    own = {_field(deb, "Package") for deb in debs}
    found = [
        re.split(r"[ (|:]", part.strip(), maxsplit=1)[0]
        for depends in fields
        for part in depends.split(",")
        if part.strip()
    ]
    return [name for name in found if name not in own]


def _field(deb: Path, name: str) -> str:
    done = subprocess.run(["dpkg-deb", "-f", str(deb), name], capture_output=True, text=True)
    if done.returncode:
        raise HypermaskError("APL-BUILD", f"{deb} is no .deb", "Build it (make deb).")
    return done.stdout.strip()


def _base(folder: Path, packages: Sequence[str]) -> Path:
    """The root file system without our .deb: made once for each recipe."""
    base, mark = folder / "base", folder / "base.recipe"
    if _reads(mark, recipe(packages)) and base.is_dir():
        return base
    folder.mkdir(parents=True, exist_ok=True)
    mark.unlink(missing_ok=True)
    shutil.rmtree(base, ignore_errors=True)
    # An initial RAM disk with nothing but this machine's disk starts in half the time.
    modules = "\\n".join(_MODULES)
    settings = "$1/etc/initramfs-tools"
    _run(
        "mmdebstrap", "--variant=minbase", f"--include={','.join(packages)}",
        *(f"--dpkgopt=path-exclude=/usr/share/{name}/*" for name in _UNKEPT),
        '--aptopt=Apt::Install-Recommends "false"', "--dpkgopt=force-unsafe-io",
        f"--extract-hook=mkdir -p {settings}/conf.d",
        f"--extract-hook=echo MODULES=list >{settings}/conf.d/cart",
        f"--extract-hook=printf '{modules}\\n' >{settings}/modules",
        SUITE, str(base),
    )  # fmt: skip
    mark.write_text(recipe(packages), "utf-8")
    return base


def _install(root: Path, debs: Sequence[Path]) -> None:
    if not debs:
        return
    shelf = root / "var/cache/cart"
    shelf.mkdir()
    for deb in debs:
        shutil.copy(deb, shelf)
    names = [f"/var/cache/cart/{deb.name}" for deb in debs]
    _run("chroot", str(root), "env", "DEBIAN_FRONTEND=noninteractive", "dpkg", "-i", *names)
    shutil.rmtree(shelf)


def _prepare(root: Path) -> None:
    """It has played before: its first show's textures would keep an emulated processor busy for
    minutes."""
    as_service = (
        "setpriv", "--reuid=hypermask", "--regid=hypermask", "--init-groups",
        "env", "HYPERMASK_HOME=/var/lib/hypermask",
    )  # fmt: skip
    rights = ("-m", "1770", "-o", "root", "-g", "hypermask")  # as debian/hypermask.tmpfiles has it
    _run("chroot", str(root), "install", "-d", *rights, "/var/lib/hypermask")
    _run("chroot", str(root), *as_service, "hypermask", "face", "prepare")


def _boot(root: Path, name: str) -> Path:
    """The newest kernel file."""
    return sorted((root / "boot").glob(f"{name}-*"))[-1]


def _furnish(root: Path) -> None:
    shutil.copytree(FURNITURE, root, dirs_exist_ok=True)
    shutil.copy(guest.__file__, root / "usr/local/lib/cart/agent.py")
    wants = root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True, exist_ok=True)
    for unit in sorted(FURNITURE.glob("etc/systemd/system/cart-*.service")):
        link = wants / unit.name
        link.unlink(missing_ok=True)
        link.symlink_to(f"/etc/systemd/system/{unit.name}")
    machine = root / "etc/hypermask/machine.toml"
    machine.parent.mkdir(exist_ok=True)
    machine.write_text(MACHINE, "utf-8")
    (root / "etc/hostname").write_text("cart\n", "utf-8")
    # Not a first boot: that one presets all units and rebuilds caches, once in an appliance's life.
    (root / "etc/machine-id").write_text(f"{_digest([b'cart']) * 2}\n", "utf-8")
    for folder in ("etc", "var"):
        (root / folder / ".updated").touch()
    for folder in ("host", "source"):
        (root / folder).mkdir(exist_ok=True)


def _furniture() -> list[Path]:
    return sorted(path for path in FURNITURE.rglob("*") if path.is_file())


def _digest(parts: object) -> str:
    digest = hashlib.sha256()
    for part in parts:  # type: ignore[attr-defined]
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:16]


def _reads(mark: Path, wanted: str) -> bool:
    return mark.exists() and mark.read_text("utf-8") == wanted


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
    parser.add_argument("debs", type=Path, nargs="*", help="what is installed on it")
    arguments = parser.parse_args()
    print(build(arguments.folder, arguments.debs).disk)


if __name__ == "__main__":
    main()
