"""The window: without a display there is one line, and the process lives."""

import ctypes.util

import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.arena import arena  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402


@pytest.mark.skipif(ctypes.util.find_library("X11") is None, reason="there is no X11 library")
def test_without_a_display_the_reason_is_told(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":9977")
    with pytest.raises(OSError, match="gui is true, but the display ':9977' cannot be opened"):
        Simulation(arena(), SimulationParameters(), 1, gui=True)
