"""The controllers' parameters in the server's file and the burger's wheels tell of one robot."""

import pytest

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.lockstep.settings import config_folder, load_settings
from mbf_relay.plugins import create
from mbf_relay.simulation.drive import approach
from mbf_relay.simulation.robot_file import load_robot

PERIOD, STEP = 0.1, 0.01
SERVER = load_settings(config_folder())["move_base_flex"]
AS_TOLD = [entry for entry in SERVER["controllers"] if entry["name"] != "DWAPlannerROS"]
"""DWA touched nothing in 330 obstacle fields at 0.8 m/s as it is, and takes 3 % longer for the tutorial's circle where
it may speed up less."""


@pytest.mark.parametrize("top", [0.22, 0.8])
@pytest.mark.parametrize("entry", AS_TOLD, ids=[entry["name"] for entry in AS_TOLD])
def test_one_that_speeds_up_out_of_a_curve_turns_as_it_is_told(entry, top):
    """Told as much of both at once as its wheels do of either, it turned on by 0.9 rad/s too much, into what was there.
    """
    p = create(entry["name"], entry["type"], SERVER[entry["name"]], Controller, CONTROLLERS).parameters
    burger = load_robot("burger")
    arm, rim = burger.wheels.separation / 2.0, burger.settings["wheel_acceleration"] * STEP
    speed, turn, off = 0.0, p.max_vel_theta, []
    wheels = [speed - arm * turn, speed + arm * turn]
    while speed < top:
        speed = min(top, speed + p.acc_lim_x * PERIOD)
        turn = max(0.0, turn - p.acc_lim_theta * PERIOD)
        for _ in range(round(PERIOD / STEP)):
            wheels = [approach(*each, rim) for each in zip(wheels, (speed - arm * turn, speed + arm * turn))]
        off.append(abs((wheels[1] - wheels[0]) / (2.0 * arm) - turn))
    assert max(off) < 0.02, off
