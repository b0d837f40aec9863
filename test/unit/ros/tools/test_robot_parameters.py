"""What is printed for a robot: parameters by which the nodes drive it."""

from pathlib import Path

from mbf_relay.ros.tools.robot_parameters import parameters_for
from mbf_relay.simulation.robot_file import load_robot

URDF = Path(__file__).resolve().parents[3] / "launch_files" / "box_on_wheels.urdf"


def test_nodes_are_told_the_frames_of_a_robot_s_own_description():
    """With the burger's names no node found its way from the lidar to the robot, and it never drove."""
    made = parameters_for(load_robot(str(URDF)))
    server = made["move_base_flex"]
    assert server["robot_frame"] == made["amcl"]["base_frame_id"] == made["velocity_guard"]["base_frame"]
    assert server["robot_frame"] == "turning_center", "its axle is 3 cm ahead of base_link"
    for costmap in (server["global_costmap"], server["local_costmap"]):
        assert costmap["robot_base_frame"] == "turning_center" and costmap["scan"]["sensor_frame"] == "front_laser"


def test_those_of_a_robot_of_the_package_are_as_they_were():
    made = parameters_for(load_robot("waffle"))
    assert "base_frame" not in made["velocity_guard"] and "robot_frame" not in made["move_base_flex"]
    assert "scan" not in made["move_base_flex"]["local_costmap"]
