"""What package.xml asks for is what rosdep can install: one key it does not know, and it installs nothing at all."""

import re
import xml.etree.ElementTree as ElementTree

import pytest
from readmes import ROOT

KNOWN = (
    # Packages of ROS: in the lists of Debian's python3-rosdep2 0.22.1 and in rosdistro's noetic.
    "actionlib actionlib_msgs catkin diagnostic_msgs dynamic_reconfigure geometry_msgs map_msgs message_generation "
    "message_runtime move_base_msgs nav_msgs robot_state_publisher rosbag rosbash rosgraph_msgs roslaunch rosmsg "
    "rosnode rospy rosservice rostest rostopic rviz sensor_msgs std_msgs std_srvs tf2_msgs tf2_ros trajectory_msgs "
    "visualization_msgs "
    # In rosdistro's base.yaml and python.yaml, for bookworm and for focal.
    "imagemagick python3-defusedxml python3-dev python3-hypothesis python3-matplotlib python3-numba python3-numpy "
    "python3-pil python3-psutil python3-pybullet-pip python3-pytest python3-scipy python3-setuptools "
    "python3-tornado python3-yaml xdotool xvfb"
)
"""Keys looked up there with `rosdep install --simulate`; look a new one up before it is added."""
ONLY_IN_NOETIC = {"mbf_msgs"}
PACKAGE = ElementTree.parse(str(ROOT / "package.xml")).getroot()
DEPENDENCIES = [entry for entry in PACKAGE if entry.tag.endswith("depend")]


@pytest.mark.parametrize("name", sorted({entry.text for entry in DEPENDENCIES}))
def test_rosdep_does_not_give_up_on_a_workspace_for_a_key_it_does_not_know(name):
    conditions = [entry.get("condition", "") for entry in DEPENDENCIES if entry.text == name]
    if name in ONLY_IN_NOETIC:
        assert all(re.fullmatch(r"\$ROS_DISTRO == noetic", condition) for condition in conditions)
    else:
        assert name in KNOWN.split(), f"rosdep has no key {name} that was looked up"


def test_nobody_installs_a_library_that_nothing_imports():
    """OpenCV, for three functions that are also elsewhere, was two fifths of the packages that a new machine got."""
    names = {"pil": "PIL", "pybullet-pip": "pybullet"}
    libraries = {
        names.get(name, name) for name in (
            entry.text[len("python3-"):] for entry in DEPENDENCIES
            if entry.tag == "exec_depend" and entry.text.startswith("python3-"))
    }
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    assert {name for name in libraries if not re.search(rf"\b(import|from) {name}\b", text)} == set()
