"""The controllers the contract is held against, each with the burger's limits."""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kinematics import TURTLEBOT3  # noqa: E402

from mbf_relay.control import CONTROLLERS  # noqa: E402
from mbf_relay.control.controller import Controller  # noqa: E402
from mbf_relay.plugins import create  # noqa: E402

EXTRA = {"regulated_pure_pursuit": {"desired_linear_vel": 0.22}}
NAMES = sorted(CONTROLLERS)


def make(name, **changes):
    """Return a controller by the type name users write, with the tutorials' limits."""
    return create(name, name, {**TURTLEBOT3, **EXTRA.get(name, {}), **changes}, Controller, CONTROLLERS)
