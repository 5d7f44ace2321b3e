"""The display interface's numbers, against those known and against the headers where they are."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.gbm import Handle

KNOWN = {
    "DRM_IOCTL_GET_CAP": (abi.GET_CAP, 0xC010640C),
    "DRM_IOCTL_SET_CLIENT_CAP": (abi.SET_CLIENT_CAP, 0x4010640D),
    "DRM_IOCTL_SET_MASTER": (abi.SET_MASTER, 0x0000641E),
    "DRM_IOCTL_DROP_MASTER": (abi.DROP_MASTER, 0x0000641F),
    "DRM_IOCTL_CRTC_GET_SEQUENCE": (abi.CRTC_GET_SEQUENCE, 0xC018643B),
    "DRM_IOCTL_MODE_GETRESOURCES": (abi.GET_RESOURCES, 0xC04064A0),
    "DRM_IOCTL_MODE_GETENCODER": (abi.GET_ENCODER, 0xC01464A6),
    "DRM_IOCTL_MODE_GETCONNECTOR": (abi.GET_CONNECTOR, 0xC05064A7),
    "DRM_IOCTL_MODE_GETPROPERTY": (abi.GET_PROPERTY, 0xC04064AA),
    "DRM_IOCTL_MODE_RMFB": (abi.REMOVE_FRAMEBUFFER, 0xC00464AF),
    "DRM_IOCTL_MODE_GETPLANERESOURCES": (abi.GET_PLANE_RESOURCES, 0xC01064B5),
    "DRM_IOCTL_MODE_GETPLANE": (abi.GET_PLANE, 0xC02064B6),
    "DRM_IOCTL_MODE_ADDFB2": (abi.ADD_FRAMEBUFFER2, 0xC06864B8),
    "DRM_IOCTL_MODE_OBJ_GETPROPERTIES": (abi.GET_OBJECT_PROPERTIES, 0xC02064B9),
    "DRM_IOCTL_MODE_ATOMIC": (abi.ATOMIC, 0xC03864BC),
    "DRM_IOCTL_MODE_CREATEPROPBLOB": (abi.CREATE_BLOB, 0xC01064BD),
    "DRM_IOCTL_MODE_DESTROYPROPBLOB": (abi.DESTROY_BLOB, 0xC00464BE),
}

FACTS = {
    "DRM_MODE_OBJECT_CRTC": abi.OBJECT_CRTC,
    "DRM_MODE_OBJECT_CONNECTOR": abi.OBJECT_CONNECTOR,
    "DRM_MODE_OBJECT_PLANE": abi.OBJECT_PLANE,
    "DRM_CLIENT_CAP_ATOMIC": abi.CLIENT_CAP_ATOMIC,
    "DRM_CAP_TIMESTAMP_MONOTONIC": abi.CAP_TIMESTAMP_MONOTONIC,
    "DRM_MODE_PAGE_FLIP_EVENT": abi.PAGE_FLIP_EVENT,
    "DRM_MODE_ATOMIC_NONBLOCK": abi.ATOMIC_NONBLOCK,
    "DRM_MODE_ATOMIC_ALLOW_MODESET": abi.ATOMIC_ALLOW_MODESET,
    "DRM_FORMAT_XRGB8888": abi.FORMAT_XRGB8888,
    "DRM_EVENT_FLIP_COMPLETE": abi.EVENT_FLIP_COMPLETE,
    "DRM_MODE_FLAG_NVSYNC": abi.FLAG_NVSYNC,
    "DRM_MODE_FLAG_INTERLACE": abi.FLAG_INTERLACE,
    "sizeof(struct drm_mode_modeinfo)": ctypes.sizeof(abi.ModeInfo),
    "sizeof(struct drm_event_vblank)": ctypes.sizeof(abi.VblankEvent),
    "sizeof(struct drm_color_lut)": ctypes.sizeof(abi.ColorLut),
    "sizeof(struct drm_mode_property_enum)": 40,
    "offsetof(struct drm_mode_fb_cmd2, modifier)": abi.Framebuffer.modifier.offset,
    "offsetof(struct drm_event_vblank, tv_sec)": abi.VblankEvent.seconds.offset,
    "offsetof(struct drm_mode_get_connector, connection)": abi.GetConnector.connection.offset,
}

FOLDERS = [Path("/usr/include/libdrm"), Path("/usr/include/drm")]
HEADERS = next((folder for folder in FOLDERS if (folder / "drm_mode.h").exists()), None)


@pytest.mark.parametrize("name", KNOWN)
def test_request_numbers_are_the_kernels(name: str) -> None:
    computed, known = KNOWN[name]
    assert f"{computed:#x}" == f"{known:#x}"


def test_a_mode_and_an_event_have_the_kernels_size() -> None:
    assert ctypes.sizeof(abi.ModeInfo) == 68
    assert ctypes.sizeof(abi.VblankEvent) == 32


@pytest.mark.skipif(
    shutil.which("gcc") is None or HEADERS is None, reason="no C compiler or no DRM headers"
)
def test_the_kernels_own_headers_agree(tmp_path: Path) -> None:
    wanted = {name: known for name, (_, known) in KNOWN.items()} | FACTS
    lines = [f'printf("%llu\\n", (unsigned long long)(unsigned)({each}));' for each in wanted]
    headers = ("stdio.h", "stddef.h", "drm.h", "drm_mode.h", "drm_fourcc.h")
    source = "".join(f"#include <{header}>\n" for header in headers)
    (tmp_path / "numbers.c").write_text(source + "int main(void) {" + "\n".join(lines) + "}")
    program = tmp_path / "numbers"
    command = ["gcc", f"-I{HEADERS}", "-o", str(program), str(tmp_path / "numbers.c")]
    subprocess.run(command, check=True)
    output = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    told = [int(line) for line in output.split()]
    assert dict(zip(wanted, told, strict=True)) == wanted


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_a_buffers_handle_comes_as_c_returns_a_union(tmp_path: Path) -> None:
    (tmp_path / "bo.c").write_text(
        "#include <stdint.h>\n"
        "union gbm_bo_handle { void *ptr; int32_t s32; uint32_t u32; uint64_t u64; };\n"
        "union gbm_bo_handle get(void *bo) {\n"
        "    union gbm_bo_handle handle = {.u64 = 0x100000000}; handle.u64 |= (uintptr_t)bo;\n"
        "    return handle;\n}\n"
    )
    library = tmp_path / "bo.so"
    command = ["gcc", "-shared", "-fPIC", "-o", str(library), str(tmp_path / "bo.c")]
    subprocess.run(command, check=True)
    get = ctypes.CDLL(str(library)).get
    get.restype, get.argtypes = Handle, [ctypes.c_void_p]
    assert get(7).u64 == 0x100000007
