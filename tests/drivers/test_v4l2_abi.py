"""The numbers that the kernel's headers give, and the headers themselves where a compiler is."""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hypermask_drivers.camera import v4l2_abi as abi

X86_64_OR_ARM64 = pytest.mark.skipif(
    ctypes.sizeof(ctypes.c_void_p) != 8, reason="the known numbers are those of 64-bit kernels"
)

KNOWN = {
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "G_FMT": 0xC0D05604,
    "S_FMT": 0xC0D05605,
    "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609,
    "QBUF": 0xC058560F,
    "DQBUF": 0xC0585611,
    "STREAMON": 0x40045612,
    "STREAMOFF": 0x40045613,
    "G_PARM": 0xC0CC5615,
    "S_PARM": 0xC0CC5616,
    "ENUMINPUT": 0xC050561A,
    "G_CTRL": 0xC008561B,
    "S_CTRL": 0xC008561C,
    "QUERYCTRL": 0xC0445624,
    "G_INPUT": 0x80045626,
    "S_INPUT": 0xC0045627,
    "G_EXT_CTRLS": 0xC0205647,
    "S_DV_TIMINGS": 0xC0845657,
    "QUERY_DV_TIMINGS": 0x80845663,
}

CONSTANTS = {
    "V4L2_CID_EXPOSURE": abi.CID_EXPOSURE,
    "V4L2_CID_AUTOGAIN": abi.CID_AUTOGAIN,
    "V4L2_CID_GAIN": abi.CID_GAIN,
    "V4L2_CID_EXPOSURE_AUTO": abi.CID_EXPOSURE_AUTO,
    "V4L2_CID_EXPOSURE_ABSOLUTE": abi.CID_EXPOSURE_ABSOLUTE,
    "V4L2_CID_EXPOSURE_AUTO_PRIORITY": abi.CID_EXPOSURE_AUTO_PRIORITY,
    "V4L2_CID_VBLANK": abi.CID_VBLANK,
    "V4L2_CID_HBLANK": abi.CID_HBLANK,
    "V4L2_CID_ANALOGUE_GAIN": abi.CID_ANALOGUE_GAIN,
    "V4L2_CID_PIXEL_RATE": abi.CID_PIXEL_RATE,
    "V4L2_BUF_FLAG_ERROR": abi.BUF_FLAG_ERROR,
    "V4L2_BUF_FLAG_TIMESTAMP_MASK": abi.BUF_FLAG_TIMESTAMP_MASK,
    "V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC": abi.BUF_FLAG_TIMESTAMP_MONOTONIC,
    "V4L2_BUF_FLAG_TSTAMP_SRC_MASK": abi.BUF_FLAG_TSTAMP_SRC_MASK,
    "V4L2_BUF_FLAG_TSTAMP_SRC_SOE": abi.BUF_FLAG_TSTAMP_SRC_SOE,
    "V4L2_CAP_STREAMING": abi.CAP_STREAMING,
    "V4L2_CAP_DEVICE_CAPS": abi.CAP_DEVICE_CAPS,
    "V4L2_IN_CAP_DV_TIMINGS": abi.IN_CAP_DV_TIMINGS,
    "V4L2_PIX_FMT_GREY": abi.fourcc("GREY"),
    "V4L2_PIX_FMT_Y10": abi.fourcc("Y10 "),
    "V4L2_PIX_FMT_Y10P": abi.fourcc("Y10P"),
    "V4L2_PIX_FMT_MJPEG": abi.fourcc("MJPG"),
}

OFFSETS = {
    "struct v4l2_buffer, timestamp": abi.Buffer.timestamp.offset,
    "struct v4l2_buffer, sequence": abi.Buffer.sequence.offset,
    "struct v4l2_buffer, m": abi.Buffer.m.offset,
    "struct v4l2_buffer, length": abi.Buffer.length.offset,
    "struct v4l2_format, fmt": abi.Format.fmt.offset,
    "struct v4l2_input, capabilities": abi.Input.capabilities.offset,
    "struct v4l2_ext_controls, controls": abi.ExtendedControls.controls.offset,
    "struct v4l2_queryctrl, minimum": abi.QueryControl.minimum.offset,
}


@X86_64_OR_ARM64
@pytest.mark.parametrize("name", KNOWN)
def test_request_numbers_are_the_kernels(name: str) -> None:
    assert f"{getattr(abi, name):#x}" == f"{KNOWN[name]:#x}"


@X86_64_OR_ARM64
def test_a_buffer_has_its_time_in_64_bits() -> None:
    assert ctypes.sizeof(abi.Buffer) == 88
    assert abi.Buffer.timestamp.size == 16
    assert abi.Buffer.sequence.offset == 56


def test_extended_controls_are_packed() -> None:
    assert ctypes.sizeof(abi.ExtendedControl) == 20


def test_four_letters_there_and_back() -> None:
    assert abi.fourcc("GREY") == 0x59455247
    assert abi.fourcc_name(abi.fourcc("Y10 ")) == "Y10 "


@X86_64_OR_ARM64
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
@pytest.mark.skipif(not Path("/usr/include/linux/videodev2.h").exists(), reason="no kernel headers")
def test_the_kernels_own_headers_agree(tmp_path: Path) -> None:
    wanted = {f"VIDIOC_{name}": getattr(abi, name) for name in KNOWN} | CONSTANTS
    wanted |= {f"offsetof({each})": value for each, value in OFFSETS.items()}
    lines = [f'printf("%llu\\n", (unsigned long long)({each}));' for each in wanted]
    headers = ("stdio.h", "stddef.h", "sys/time.h", "linux/videodev2.h")
    source = "".join(f"#include <{header}>\n" for header in headers)
    (tmp_path / "numbers.c").write_text(source + "int main(void) {" + "\n".join(lines) + "}")
    program = tmp_path / "numbers"
    subprocess.run(["gcc", "-o", program, tmp_path / "numbers.c"], check=True)
    output = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    told = [int(line) & 0xFFFFFFFF for line in output.split()]
    assert dict(zip(wanted, told, strict=True)) == wanted
    assert sys.maxsize > 2**32
