"""An OpenGL ES 3 context without any window or display, made by hand through EGL.

moderngl's own EGL backend knows desktop OpenGL only, and the GPUs of single-board computers
speak GLES; so the context is made here and handed to moderngl.

Each call of `create_context` gives a context of its own, current in the calling thread. Several
may live in one process: wrap what draws with one in ``with context:``, which makes it current and
afterwards restores the one before (it costs nothing when it is current already). Objects are not
shared between contexts. Parts that draw in turn may as well use one context together, each with
framebuffers of its own, provided that each sets all the state that it needs before it draws.
A context may be current in one thread at a time.

Source: EGL 1.5 specification; EGL_MESA_platform_surfaceless; EGL_EXT_platform_device;
EGL_KHR_surfaceless_context.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from ctypes import c_char_p, c_int32, c_uint32, c_void_p
from functools import cache
from typing import Any

import moderngl

from hypermask_drivers.errors import DeviceAbsent, DeviceError

_EXTENSIONS = 0x3055
_NONE = 0x3038
_SURFACE_TYPE = 0x3033
_WINDOW_BIT = 0x0004
_RED_SIZE, _GREEN_SIZE, _BLUE_SIZE, _DEPTH_SIZE = 0x3024, 0x3023, 0x3022, 0x3025
_NATIVE_VISUAL_ID = 0x302E
_RENDERABLE_TYPE = 0x3040
_OPENGL_ES3_BIT = 0x0040
_OPENGL_ES_API = 0x30A0
_CONTEXT_MAJOR_VERSION = 0x3098
_CONTEXT_MINOR_VERSION = 0x30FB
_PLATFORM_GBM = 0x31D7
_PLATFORM_SURFACELESS = 0x31DD
_PLATFORM_DEVICE = 0x313F

_REQUIRED_VERSION = 300
_DRIVER_REMEDY = "Install the packages libegl1 and libgl1-mesa-dri, or the GPU's own driver."


@cache
def _egl() -> ctypes.CDLL:
    """libEGL with its signatures. Raises `DeviceAbsent` GPU-EGL."""
    try:
        lib = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        raise DeviceAbsent(
            "GPU-EGL", "the library libEGL.so.1 cannot be loaded", _DRIVER_REMEDY
        ) from error
    attributes = ctypes.POINTER(c_int32)
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "eglGetProcAddress": (c_void_p, [c_char_p]),
        "eglGetError": (c_int32, []),
        "eglQueryString": (c_char_p, [c_void_p, c_int32]),
        "eglInitialize": (c_uint32, [c_void_p, attributes, attributes]),
        "eglBindAPI": (c_uint32, [c_uint32]),
        "eglChooseConfig": (
            c_uint32,
            [c_void_p, attributes, ctypes.POINTER(c_void_p), c_int32, attributes],
        ),
        "eglCreateContext": (c_void_p, [c_void_p, c_void_p, c_void_p, attributes]),
        "eglDestroyContext": (c_uint32, [c_void_p, c_void_p]),
        "eglMakeCurrent": (c_uint32, [c_void_p, c_void_p, c_void_p, c_void_p]),
        "eglGetCurrentContext": (c_void_p, []),
        "eglGetCurrentDisplay": (c_void_p, []),
        "eglGetCurrentSurface": (c_void_p, [c_int32]),
        "eglGetConfigAttrib": (c_uint32, [c_void_p, c_void_p, c_int32, attributes]),
        "eglCreateWindowSurface": (c_void_p, [c_void_p, c_void_p, c_void_p, attributes]),
        "eglDestroySurface": (c_uint32, [c_void_p, c_void_p]),
        "eglSwapBuffers": (c_uint32, [c_void_p, c_void_p]),
        "eglTerminate": (c_uint32, [c_void_p]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(lib, name)
        function.restype = result
        function.argtypes = arguments
    return lib


class EglContext:
    """An EGL context as moderngl wants it: a loader of functions that can be made current.

    display, context: EGL handles; surface: EGL surface to draw on, None without one.
    """

    def __init__(self, display: int, context: int, surface: int | None = None) -> None:
        self._display = display
        self._context: int | None = context
        self._surface = surface
        self._outer: list[tuple[int | None, int | None, int | None, int | None] | None] = []

    def load_opengl_function(self, name: str) -> int:
        """Address of a GLES function, 0 if there is none."""
        return int(_egl().eglGetProcAddress(name.encode()) or 0)

    load = load_opengl_function

    def make_current(self) -> None:
        """Raises `DeviceError` GPU-CURRENT, e.g. when another thread holds it."""
        ok = _egl().eglMakeCurrent(self._display, self._surface, self._surface, self._context)
        if not ok:
            raise DeviceError(
                "GPU-CURRENT",
                f"the graphics context cannot be made current (EGL 0x{_egl().eglGetError():x})",
                "Restart the program; report it if it comes again.",
            )

    def __enter__(self) -> EglContext:
        egl = _egl()
        current = egl.eglGetCurrentContext()
        if current == self._context:
            self._outer.append(None)
            return self
        display = egl.eglGetCurrentDisplay() or self._display
        surfaces = [egl.eglGetCurrentSurface(kind) for kind in (0x3059, 0x305A)]
        self.make_current()
        self._outer.append((display, surfaces[0], surfaces[1], current))
        return self

    def __exit__(self, *error: object) -> None:  # moderngl passes no arguments
        outer = self._outer.pop()
        if outer is not None:
            _egl().eglMakeCurrent(*outer)

    def swap(self) -> None:
        """End the surface's picture. Raises `DeviceError` GPU-SWAP."""
        if not _egl().eglSwapBuffers(self._display, self._surface):
            raise DeviceError(
                "GPU-SWAP",
                f"the GPU's driver cannot end a picture (EGL 0x{_egl().eglGetError():x})",
                "Restart the program; report it if it comes again.",
            )

    def release(self) -> None:
        """Destroy the context with everything in it. May be called again."""
        if self._context is None:
            return
        egl = _egl()
        if egl.eglGetCurrentContext() == self._context:
            egl.eglMakeCurrent(self._display, None, None, None)
        egl.eglDestroyContext(self._display, self._context)
        if self._surface is not None:
            egl.eglDestroySurface(self._display, self._surface)
        self._context = self._surface = None


def create_context() -> moderngl.Context:
    """A new GLES 3.0+ context that draws off screen, current in this thread.

    Raises `DeviceAbsent` GPU-EGL (no libEGL), GPU-DISPLAY (no EGL platform without a display),
    GPU-GLES (no OpenGL ES 3).
    """
    return wrap(_create_egl_context(_headless_display()))


def wrap(egl_context: EglContext) -> moderngl.Context:
    """A moderngl context over an EGL context. Raises `DeviceAbsent` GPU-GLES."""
    egl_context.make_current()
    try:
        settings: dict[str, Any] = {"context": egl_context}
        return moderngl.create_context(require=_REQUIRED_VERSION, **settings)
    except Exception as error:  # moderngl raises its own and plain Exceptions here
        egl_context.release()
        raise DeviceAbsent(
            "GPU-GLES", f"no OpenGL ES 3 context ({error})", _DRIVER_REMEDY
        ) from error


@cache
def _headless_display() -> int:
    """An initialised EGL display that needs no window system: Mesa's, else a GPU's own."""
    for display in _candidate_displays():
        version = (c_int32(), c_int32())
        if _egl().eglInitialize(display, ctypes.byref(version[0]), ctypes.byref(version[1])):
            extensions = (_egl().eglQueryString(display, _EXTENSIONS) or b"").split()
            if b"EGL_KHR_surfaceless_context" in extensions:
                return display
    raise DeviceAbsent("GPU-DISPLAY", "EGL offers no way to draw without a display", _DRIVER_REMEDY)


def _candidate_displays() -> Iterator[int]:
    extensions = (_egl().eglQueryString(None, _EXTENSIONS) or b"").split()
    get_display = _function(
        "eglGetPlatformDisplayEXT", c_void_p, c_uint32, c_void_p, ctypes.POINTER(c_int32)
    )
    if get_display is None:
        return
    if b"EGL_MESA_platform_surfaceless" in extensions:
        display = get_display(_PLATFORM_SURFACELESS, None, None)
        if display:
            yield display
    if b"EGL_EXT_platform_device" in extensions:
        for device in _devices():
            display = get_display(_PLATFORM_DEVICE, device, None)
            if display:
                yield display


def _devices() -> list[int]:
    query = _function(
        "eglQueryDevicesEXT", c_uint32, c_int32, ctypes.POINTER(c_void_p), ctypes.POINTER(c_int32)
    )
    devices, count = (c_void_p * 16)(), c_int32()
    if query is None or not query(len(devices), devices, ctypes.byref(count)):
        return []
    return [device for device in devices[: count.value] if device]


def _function(name: str, result: Any, *arguments: Any) -> Callable[..., Any] | None:
    """An EGL extension's function, None if it is not there."""
    address = _egl().eglGetProcAddress(name.encode())
    return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None


class WindowConfig:
    """An EGL display of a GBM device with a configuration whose pixels a screen can show."""

    def __init__(self, display: int, config: int) -> None:
        self._display: int | None = display
        self._config = config

    def context(self, window: int) -> EglContext:
        """A context that draws on a window (a GBM surface). Raises `DeviceAbsent` GPU-GLES."""
        egl = _egl()
        egl.eglBindAPI(_OPENGL_ES_API)
        surface = egl.eglCreateWindowSurface(self._display, self._config, window, None)
        attributes = (c_int32 * 5)(_CONTEXT_MAJOR_VERSION, 3, _CONTEXT_MINOR_VERSION, 0, _NONE)
        context = egl.eglCreateContext(self._display, self._config, None, attributes)
        if not surface or not context or self._display is None:
            raise _no_gles()
        return EglContext(self._display, context, surface)

    def terminate(self) -> None:
        """May be called again."""
        if self._display is not None:
            _egl().eglTerminate(self._display)
        self._display = None


def window_config(gbm_device: int, visual: int) -> WindowConfig:
    """visual: the DRM pixel format's four letters as a number.

    Raises `DeviceAbsent` GPU-EGL, GPU-DISPLAY, GPU-GLES.
    """
    get_display = _function(
        "eglGetPlatformDisplayEXT", c_void_p, c_uint32, c_void_p, ctypes.POINTER(c_int32)
    )
    display = get_display(_PLATFORM_GBM, gbm_device, None) if get_display else None
    if not display or not _egl().eglInitialize(display, None, None):
        raise DeviceAbsent("GPU-DISPLAY", "EGL cannot draw for the display card", _DRIVER_REMEDY)
    wanted = (c_int32 * 13)(
        _SURFACE_TYPE, _WINDOW_BIT, _RENDERABLE_TYPE, _OPENGL_ES3_BIT,
        _RED_SIZE, 8, _GREEN_SIZE, 8, _BLUE_SIZE, 8, _DEPTH_SIZE, 24, _NONE,
    )  # fmt: skip
    configs, count, value = (c_void_p * 256)(), c_int32(), c_int32()
    _egl().eglChooseConfig(display, wanted, configs, len(configs), ctypes.byref(count))
    for config in configs[: count.value]:
        _egl().eglGetConfigAttrib(display, config, _NATIVE_VISUAL_ID, ctypes.byref(value))
        if value.value == visual and config:
            return WindowConfig(display, config)
    _egl().eglTerminate(display)
    raise _no_gles()


def _no_gles() -> DeviceAbsent:
    return DeviceAbsent(
        "GPU-GLES",
        f"the GPU's driver gives no OpenGL ES 3 context (EGL 0x{_egl().eglGetError():x})",
        _DRIVER_REMEDY,
    )


def _create_egl_context(display: int) -> EglContext:
    egl = _egl()
    egl.eglBindAPI(_OPENGL_ES_API)
    config, count = c_void_p(), c_int32()
    wanted = (c_int32 * 5)(_RENDERABLE_TYPE, _OPENGL_ES3_BIT, _SURFACE_TYPE, 0, _NONE)
    found = egl.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
    attributes = (c_int32 * 5)(_CONTEXT_MAJOR_VERSION, 3, _CONTEXT_MINOR_VERSION, 0, _NONE)
    context = (
        egl.eglCreateContext(display, config, None, attributes) if found and count.value else None
    )
    if not context:
        raise _no_gles()
    return EglContext(display, context)
