"""Buffers that a GPU draws in and a display shows (libgbm), and the EGL window over them.

Source: gbm.h of Mesa; EGL_KHR_platform_gbm.
"""

from __future__ import annotations

import ctypes
from ctypes import c_int32, c_uint32, c_uint64, c_void_p
from functools import cache
from typing import Any

import moderngl

from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.gles import EglContext, WindowConfig, window_config, wrap

_SCANOUT, _RENDERING = 1, 4
_REMEDY = "Install the packages libgbm1 and libgl1-mesa-dri, or the GPU's own driver."


class Handle(ctypes.Structure):
    """union gbm_bo_handle: 32-bit ARM returns it otherwise than a number of 64 bits."""

    _fields_ = (("u64", c_uint64),)


@cache
def _gbm() -> ctypes.CDLL:
    """libgbm with its signatures. Raises `DeviceAbsent` GPU-GBM."""
    try:
        lib = ctypes.CDLL("libgbm.so.1", use_errno=True)
    except OSError as error:
        raise DeviceAbsent(
            "GPU-GBM", "the library libgbm.so.1 cannot be loaded", _REMEDY
        ) from error
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "gbm_create_device": (c_void_p, [c_int32]),
        "gbm_device_destroy": (None, [c_void_p]),
        "gbm_surface_create": (c_void_p, [c_void_p, c_uint32, c_uint32, c_uint32, c_uint32]),
        "gbm_surface_destroy": (None, [c_void_p]),
        "gbm_surface_lock_front_buffer": (c_void_p, [c_void_p]),
        "gbm_surface_release_buffer": (None, [c_void_p, c_void_p]),
        "gbm_bo_get_handle": (Handle, [c_void_p]),
        "gbm_bo_get_stride": (c_uint32, [c_void_p]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(lib, name)
        function.restype = result
        function.argtypes = arguments
    return lib


class Screen:
    """An OpenGL ES context that draws into buffers of the size of a mode."""

    def __init__(self, descriptor: int, size: tuple[int, int]) -> None:
        """descriptor: of the open card. Raises `DeviceAbsent` GPU-GBM, GPU-EGL, GPU-DISPLAY,
        GPU-GLES."""
        self.size = size
        self._device = _gbm().gbm_create_device(descriptor)
        if not self._device:
            raise DeviceAbsent("GPU-GBM", "the display card gives no buffers", _REMEDY)
        self._surface: int | None = None
        self._config: WindowConfig | None = None
        self._egl: EglContext | None = None
        try:
            self._config = window_config(self._device, abi.FORMAT_XRGB8888)
            self._surface = _gbm().gbm_surface_create(
                self._device, *size, abi.FORMAT_XRGB8888, _SCANOUT | _RENDERING
            )
            if not self._surface:
                raise DeviceAbsent(
                    "GPU-GBM",
                    f"the display card gives no buffers of {size[0]} x {size[1]}",
                    _REMEDY,
                )
            self._egl = self._config.context(self._surface)
            self.context: moderngl.Context = wrap(self._egl)
            self.framebuffer: moderngl.Framebuffer = self.context.screen
        except BaseException:
            self.release()
            raise

    def swap(self) -> Front:
        """End the picture; the buffer that holds it, locked until it is released.

        Raises `DeviceError` GPU-SWAP.
        """
        assert self._egl is not None
        with self._egl:
            self._egl.swap()
        buffer = _gbm().gbm_surface_lock_front_buffer(self._surface)
        if not buffer:
            raise DeviceError(
                "GPU-SWAP", "the GPU's driver gives no finished picture", "Restart the program."
            )
        handle = _gbm().gbm_bo_get_handle(buffer).u64 & 0xFFFFFFFF
        return Front(buffer, handle, _gbm().gbm_bo_get_stride(buffer))

    def give_back(self, front: Front) -> None:
        _gbm().gbm_surface_release_buffer(self._surface, front.buffer)

    def release(self) -> None:
        """May be called again."""
        if self._egl is not None:
            self._egl.release()
        if self._surface:
            _gbm().gbm_surface_destroy(self._surface)
        if self._config is not None:
            self._config.terminate()
        if self._device:
            _gbm().gbm_device_destroy(self._device)
        self._egl = self._config = None
        self._surface = self._device = None


class Front:
    """A finished buffer: GBM's pointer (one of a few, it comes again), kernel handle, stride."""

    def __init__(self, buffer: int, handle: int, stride: int) -> None:
        self.buffer, self.handle, self.stride = buffer, handle, stride
