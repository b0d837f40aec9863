"""PyBullet's window: display, camera and colours."""

from __future__ import annotations

import ctypes
import os
from typing import Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.bullet import pybullet

WALLS, ROBOT = (0.55, 0.68, 0.55, 1.0), (0.20, 0.22, 0.30, 1.0)
"""Colours (RGBA)."""


def require_display() -> None:
    """Check for a display, without which PyBullet would end the process.

    Raises:
        OSError: There is none; the text says what was tried.
    """
    name = os.environ.get("DISPLAY", "")
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError as error:
        raise OSError(f"parameter gui is true, but there is no X11 library ({error}); set it to false") from error
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if not display:
        raise OSError(
            f"parameter gui is true, but the display '{name}' cannot be opened; set DISPLAY or set gui to false"
        )
    x11.XCloseDisplay(ctypes.c_void_p(display))


def tidy(client: int, start: Pose2D) -> None:
    """Close PyBullet's side panels and point the camera at the start, from behind and above."""
    for panel in (
        pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_RGB_BUFFER_PREVIEW, pybullet.COV_ENABLE_DEPTH_BUFFER_PREVIEW,
        pybullet.COV_ENABLE_SEGMENTATION_MARK_PREVIEW,
    ):
        pybullet.configureDebugVisualizer(panel, 0, physicsClientId=client)
    pybullet.resetDebugVisualizerCamera(5.0, -90.0, -55.0, (start.x + 1.5, start.y, 0.0), physicsClientId=client)


def paint(client: int, body: int, colour: Tuple[float, float, float, float]) -> None:
    """Give every link of a body a colour (red, green, blue, alpha)."""
    for link in range(-1, pybullet.getNumJoints(body, physicsClientId=client)):
        pybullet.changeVisualShape(body, link, rgbaColor=colour, physicsClientId=client)
