"""The guard's parameter file and the server's tell of one robot."""

from pathlib import Path

import yaml

from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters

CONFIG = Path(__file__).resolve().parents[3] / "config"


def read(name):
    return yaml.safe_load((CONFIG / name).read_text(encoding="utf-8"))


def test_the_guard_and_the_server_drive_one_robot():
    guard, server = read("velocity_guard.yaml"), read("move_base_flex.yaml")
    assert VelocityGuardParameters.unknown_names(guard) == []
    assert guard["footprint"] == server["local_costmap"]["footprint"]
    assert guard["base_frame"] == server["robot_frame"]


def test_the_guard_counts_on_no_harder_brakes_than_the_wheels_have():
    guard, wheels = VelocityGuardParameters.from_mapping(read("velocity_guard.yaml")), read("robot/burger.yaml")
    assert guard.acc_lim_x <= wheels["wheel_acceleration"]
    assert guard.wheel_separation == wheels["wheels"]["separation"]
