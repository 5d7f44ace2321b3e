"""Upgrades and rollbacks with dpkg itself, in a root of their own: small packages of that name."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hypermask.errors import HypermaskError
from hypermask.update.dpkg import PACKAGE, Dpkg, newer
from hypermask.update.install import Installed, install, rollback
from hypermask.update.keep import keep
from hypermask.update.shelf import Shelf

REPAIR = Path(__file__).parents[2] / "debian" / "libexec" / "repair"

pytestmark = [
    pytest.mark.skipif(not shutil.which("dpkg-deb"), reason="dpkg is not installed"),
    pytest.mark.skipif(os.geteuid() != 0, reason="dpkg installs only as root"),
]


def make_deb(
    folder: Path, version: str, content: str = "", script: str = "", preinst: str = ""
) -> Path:
    """A hypermask that is one line of code, a configuration file and a link. script: its postinst;
    both with their first line, or for sh."""
    tree = folder / f"tree-{version}"
    code = tree / "usr/share/hypermask/python/line.py"
    code.parent.mkdir(parents=True)
    code.write_text(f"VERSION = '{version}'\n{content}", "utf-8")
    (code.parent / "link.py").symlink_to("line.py")
    etc = tree / "etc/hypermask.conf"
    etc.parent.mkdir()
    etc.write_text("as shipped\n", "utf-8")
    again = tree / "usr/share/hypermask/as-shipped/etc/hypermask.conf"
    again.parent.mkdir(parents=True)
    shutil.copy(etc, again)
    control = tree / "DEBIAN"
    control.mkdir()
    (control / "conffiles").write_text("/etc/hypermask.conf\n", "utf-8")
    (control / "control").write_text(
        f"Package: {PACKAGE}\nVersion: {version}\nArchitecture: all\n"
        "Maintainer: Nobody <nobody@example.org>\nDescription: a line\n More of it.\n",
        "utf-8",
    )
    (control / "md5sums").write_bytes(
        subprocess.run(
            ["md5sum", "usr/share/hypermask/python/line.py"], cwd=tree, capture_output=True
        ).stdout
    )
    for name, text in (("postinst", script), ("preinst", preinst)):
        if text:
            first = "" if text.startswith("#!") else "#!/bin/sh\n"
            (control / name).write_text(f"{first}{text}\n", "utf-8")
            (control / name).chmod(0o755)
    target = folder / f"hypermask_{version}_all.deb"
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "-Znone", "-b", str(tree), str(target)],
        check=True,
        capture_output=True,
    )
    return target


class Cart:
    """A machine's root in a folder, with its package manager and its kept packages."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "root"
        for name in ("updates", "info", "triggers"):
            (self.root / "var/lib/dpkg" / name).mkdir(parents=True)
        (self.root / "var/lib/dpkg/status").touch()
        self.options = [f"--root={self.root}", "--force-script-chrootless", "--log=/dev/null"]
        self.dpkg = Dpkg(self.options)
        self.shelf = Shelf(folder / "packages", self.dpkg)
        self.told: list[str] = []

    def install(self, *paths: Path) -> Installed:
        return install(paths, self.shelf, self.dpkg, self.told.append)

    def rollback(self) -> Installed:
        return rollback(self.shelf, self.dpkg, self.told.append)

    @property
    def code(self) -> str:
        return (self.root / "usr/share/hypermask/python/line.py").read_text("utf-8")

    def repair(self) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", str(REPAIR)],
            env={
                **os.environ,
                "HYPERMASK_PACKAGES": str(self.shelf.folder),
                "HYPERMASK_ROOT": str(self.root),
            },
            capture_output=True,
            text=True,
        )


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cart:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))
    monkeypatch.setattr("hypermask.update.install._hold_on", lambda: None)
    return Cart(tmp_path)


def test_an_upgrade_keeps_both_packages_and_a_rollback_returns(cart: Cart, tmp_path: Path) -> None:
    one, two = make_deb(tmp_path, "1.0"), make_deb(tmp_path, "2.0")
    assert cart.install(one) == Installed("1.0", None)
    one.unlink()
    assert cart.install(two) == Installed("2.0", "1.0")
    two.unlink()
    assert "2.0" in cart.code and not cart.shelf.interrupted
    assert cart.rollback() == Installed("1.0", "2.0")
    assert "1.0" in cart.code
    assert cart.rollback() == Installed("2.0", "1.0")
    assert "2.0" in cart.code


def test_only_the_installed_and_the_previous_package_stay(cart: Cart, tmp_path: Path) -> None:
    for version in ("1.0", "2.0", "3.0"):
        cart.install(make_deb(tmp_path, version))
    kept = {path.name for path in cart.shelf.folder.glob("*.deb")}
    assert kept == {"hypermask_2.0_all.deb", "hypermask_3.0_all.deb"}
    assert not (cart.shelf.folder / "data-1.0").exists()


def test_nothing_to_go_back_to(cart: Cart, tmp_path: Path) -> None:
    cart.install(make_deb(tmp_path, "1.0"))
    with pytest.raises(HypermaskError, match="no earlier version") as caught:
        cart.rollback()
    assert caught.value.code == "UPD-NONE"


def test_a_version_that_others_installed_is_packed_again(cart: Cart, tmp_path: Path) -> None:
    """Whoever used dpkg -i and threw the file away can still go back."""
    one = make_deb(tmp_path, "1.0", script="touch $DPKG_ROOT/ran")
    cart.dpkg.install([one])
    one.unlink()
    (cart.root / "ran").unlink()
    cart.install(make_deb(tmp_path, "2.0"))
    assert cart.rollback() == Installed("1.0", "2.0")
    assert "1.0" in cart.code
    assert (cart.root / "usr/share/hypermask/python/link.py").readlink() == Path("line.py")
    assert (cart.root / "ran").exists()
    assert cart.dpkg.whole()


def test_dpkg_alone_leaves_a_way_back_too(cart: Cart, tmp_path: Path) -> None:
    """While the preinst runs, dpkg takes the old version for half installed."""
    saved = tmp_path / "home/shows/mine.toml"
    saved.parent.mkdir(parents=True)
    saved.write_text("of 1.0", "utf-8")
    cart.dpkg.install([make_deb(tmp_path, "1.0")])
    preinst = f"""#!{sys.executable}
import sys
sys.path[:0] = {sys.path!r}
from pathlib import Path
from hypermask.update import keep
keep.Dpkg = lambda: Dpkg({cart.options[:1]!r})
keep.shelf_folder = lambda: Path({str(cart.shelf.folder)!r})
from hypermask.update.dpkg import Dpkg
assert Dpkg({cart.options[:1]!r}).version() is None
sys.exit(keep.main(["--replaced", "hypermask", sys.argv[2]]))
"""
    two = make_deb(tmp_path, "2.0", preinst=preinst)
    assert not cart.shelf.folder.exists()
    done, said = cart.dpkg.install([two])
    assert done, said
    assert cart.dpkg.version() == "2.0"
    assert cart.shelf.kept("1.0") is not None
    assert (cart.shelf.data("1.0") / "shows/mine.toml").read_text("utf-8") == "of 1.0"
    cart.shelf.set_previous("1.0")  # as the package's preinst does
    assert cart.rollback() == Installed("1.0", "2.0")
    assert "1.0" in cart.code and cart.dpkg.whole()


@pytest.mark.parametrize("package", ["hypermask", "hypermask-sim"])
def test_the_preinst_says_what_goes_unless_that_is_half_a_version(package: str) -> None:
    text = (REPAIR.parents[1] / f"{package}.preinst").read_text("utf-8")
    assert f'keep --replaced {package} "$2"' in text
    assert '[ -e "$packages/installing" ] || [ ! -x /usr/libexec/hypermask/keep ] ||' in text


@pytest.mark.parametrize("owners", ["mine\n", None])
def test_what_was_packed_again_knows_the_owners_configuration(
    cart: Cart, tmp_path: Path, owners: str | None
) -> None:
    """dpkg by hand asks nothing afterwards, and leaves the owner's file as it is, or away."""
    subprocess.run(["dpkg", *cart.options, "-i", make_deb(tmp_path, "1.0")], check=True)
    etc = cart.root / "etc/hypermask.conf"
    etc.unlink() if owners is None else etc.write_text(owners, "utf-8")
    two = make_deb(tmp_path, "2.0")
    cart.install(two)
    cart.rollback()
    by_hand = subprocess.run(
        ["dpkg", *cart.options, "-i", two], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert by_hand.returncode == 0, by_hand.stdout
    assert (etc.read_text("utf-8") if etc.exists() else None) == owners


def test_changed_configuration_stays_through_upgrade_and_rollback(
    cart: Cart, tmp_path: Path
) -> None:
    cart.install(make_deb(tmp_path, "1.0"))
    conf = cart.root / "etc/hypermask.conf"
    conf.write_text("mine\n", "utf-8")
    assert cart.dpkg.whole()
    cart.install(make_deb(tmp_path, "2.0"))
    cart.rollback()
    assert conf.read_text("utf-8") == "mine\n"


def test_a_package_that_cannot_be_configured_gives_way_to_the_old_one(
    cart: Cart, tmp_path: Path
) -> None:
    cart.install(make_deb(tmp_path, "1.0"))
    with pytest.raises(HypermaskError, match=r"Version 1\.0 is back") as caught:
        cart.install(make_deb(tmp_path, "2.0", script="exit 1"))
    assert caught.value.code == "UPD-FAILED"
    assert "1.0" in cart.code and cart.dpkg.version() == "1.0"
    assert not cart.shelf.interrupted and cart.shelf.previous is None


def test_damaged_and_foreign_files_are_refused_before_anything_changes(
    cart: Cart, tmp_path: Path
) -> None:
    cart.install(make_deb(tmp_path, "1.0"))
    two = make_deb(tmp_path, "2.0", content="#" * 100_000)
    damaged = tmp_path / "cut.deb"
    damaged.write_bytes(two.read_bytes()[:50_000])
    text = tmp_path / "text.deb"
    text.write_text("no package", "utf-8")
    for path, code in ((damaged, "UPD-DAMAGED"), (text, "UPD-FILE")):
        with pytest.raises(HypermaskError) as caught:
            cart.install(path)
        assert caught.value.code == code
    assert "1.0" in cart.code and not cart.shelf.interrupted


def test_a_full_disk_is_noticed_before(
    cart: Cart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = make_deb(tmp_path, "1.0")
    usage = shutil.disk_usage(tmp_path)._replace(free=1 << 20)
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage)
    with pytest.raises(HypermaskError) as caught:
        cart.install(one)
    assert caught.value.code == "UPD-SPACE"
    assert cart.dpkg.version() is None


def test_a_package_is_kept_whole_or_not_at_all(
    cart: Cart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = cart.dpkg.package(make_deb(tmp_path, "1.0"))

    def half(source: Path, target: Path) -> None:
        Path(target).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hypermask.update.shelf.shutil.copyfile", half)
    with pytest.raises(HypermaskError) as caught:
        cart.shelf.keep(package)
    assert caught.value.code == "UPD-KEEP"
    assert list(cart.shelf.folder.iterdir()) == []


# --- power cuts ----------------------------------------------------------------------------------


def interrupted(cart: Cart, tmp_path: Path, want: str) -> None:
    """2.0 over 1.0, and the power goes when dpkg has got as far as `want`."""
    cart.install(make_deb(tmp_path, "1.0"))
    kill = "kill -9 $PPID; sleep 5"
    two = make_deb(tmp_path, "2.0", script=f"[ -e {tmp_path}/again ] || {{ {kill}; }}")
    kept = cart.shelf.keep(cart.dpkg.package(two))
    keep(cart.shelf, cart.dpkg, [])
    cart.shelf.begin([kept])
    cart.dpkg.install([kept])
    (tmp_path / "again").touch()
    status = (cart.root / "var/lib/dpkg/status").read_text("utf-8")
    if want == "unpacked":
        (cart.root / "usr/share/hypermask/python/line.py").unlink()
        text = status.replace("install ok installed", "install reinstreq half-installed")
        (cart.root / "var/lib/dpkg/status").write_text(text, "utf-8")


@pytest.mark.parametrize("want", ["configured", "unpacked"])
def test_the_next_boot_ends_an_interrupted_upgrade(cart: Cart, tmp_path: Path, want: str) -> None:
    interrupted(cart, tmp_path, want)
    assert cart.dpkg.version() is None or not cart.dpkg.whole()
    done = cart.repair()
    assert done.returncode == 0, done.stderr
    assert "<5>UPD-REPAIR: the program is whole." in done.stderr
    assert cart.dpkg.version() == "2.0" and cart.dpkg.whole() and "2.0" in cart.code
    assert not cart.shelf.interrupted


def test_where_the_new_package_is_gone_the_old_one_comes_back(cart: Cart, tmp_path: Path) -> None:
    interrupted(cart, tmp_path, "unpacked")
    cart.shelf.path_of(PACKAGE, "2.0").unlink()
    done = cart.repair()
    assert done.returncode == 0, done.stderr
    assert cart.dpkg.version() == "1.0" and "1.0" in cart.code


def test_a_boot_that_can_mend_nothing_says_so_and_keeps_the_mark(
    cart: Cart, tmp_path: Path
) -> None:
    interrupted(cart, tmp_path, "unpacked")
    for path in cart.shelf.folder.glob("*.deb"):
        path.unlink()
    done = cart.repair()
    assert done.returncode == 1
    assert "hypermask update install" in done.stderr
    assert cart.shelf.interrupted


def test_a_boot_with_a_whole_program_only_takes_the_mark_away(cart: Cart, tmp_path: Path) -> None:
    cart.install(make_deb(tmp_path, "1.0"))
    cart.shelf.begin([])
    assert cart.repair().returncode == 0
    assert not cart.shelf.interrupted and "1.0" in cart.code


def test_a_boot_configures_nobody_elses_package(cart: Cart, tmp_path: Path) -> None:
    """What others do then nobody here can know; they are the technician's, who is told."""
    interrupted(cart, tmp_path, "configured")
    status = cart.root / "var/lib/dpkg/status"
    stranger = (
        "Package: stranger\nStatus: install ok unpacked\nMaintainer: x <x@example.org>\n"
        "Architecture: all\nVersion: 1\nDescription: x\n"
    )
    ours = status.read_text("utf-8").replace(
        "Architecture: all\n", "Architecture: all\nDepends: stranger\n"
    )
    status.write_text(ours + "\n" + stranger, "utf-8")
    postinst = cart.root / "var/lib/dpkg/info/stranger.postinst"
    postinst.write_text(f"#!/bin/sh\ntouch {tmp_path}/strange\n", "utf-8")
    postinst.chmod(0o755)
    (cart.root / "var/lib/dpkg/info/stranger.list").write_text("/.\n", "utf-8")
    done = cart.repair()
    assert done.returncode == 0, done.stderr
    assert cart.dpkg.version() == "2.0"
    assert not (tmp_path / "strange").exists() and cart.dpkg.version("stranger") is None
    assert "<4>UPD-REPAIR: other packages are only half installed" in done.stderr
    assert ": stranger. Run dpkg --configure -a" in done.stderr


def test_versions_are_compared_as_debian_does() -> None:
    assert newer("0.10", "0.9") and newer("1.0", "1.0~rc1") and not newer("1.0", "1.0")
