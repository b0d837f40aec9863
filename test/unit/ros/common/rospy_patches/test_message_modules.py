"""A node reads the messages it uses, and finds each that it asks for."""

import subprocess
import sys

import pytest

PREPARE = (
    "import importlib, sys; from mbf_relay.ros.common.rospy_patches.lazy_modules import *; import_lazily(); "
)
PACKAGES = ("actionlib_msgs", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "std_srvs", "visualization_msgs")


def output(code, prepare=PREPARE):
    return subprocess.check_output([sys.executable, "-c", prepare + code], text=True, timeout=60.0).split()


def test_a_message_brings_what_it_is_made_of_and_no_other():
    code = "from nav_msgs.msg import Odometry; print(*sys.modules)"
    read = {name for name in output(code) if "._" in name and "_msgs.msg" in name}
    assert {"nav_msgs.msg._Odometry", "geometry_msgs.msg._Quaternion", "std_msgs.msg._Header"} <= read
    assert not read & {"nav_msgs.msg._GetMapAction", "geometry_msgs.msg._Wrench", "std_msgs.msg._Int8"}


@pytest.mark.parametrize("use", [
    "from sensor_msgs.msg import Imu; print(Imu._type)",
    "import sensor_msgs.msg; print(sensor_msgs.msg.Imu._type)",
    "from sensor_msgs.msg import *; print(Imu._type)",
    "from sensor_msgs.msg._Imu import Imu; print(Imu._type)",
    "from roslib.message import get_message_class; print(get_message_class('sensor_msgs/Imu')._type)",
])
def test_a_plugin_of_a_users_own_has_any_message(use):
    assert output(use) == ["sensor_msgs/Imu"]


def test_a_service_is_there_with_its_request_and_response():
    code = (
        "from nav_msgs import srv; "
        "print(srv.GetMapResponse().map.info.width, srv.GetMapRequest._type, srv.GetMap._type)"
    )
    assert output(code) == ["0", "nav_msgs/GetMapRequest", "nav_msgs/GetMap"]


def test_what_is_sent_is_read_as_it_was():
    code = """
import io
from nav_msgs.msg import Odometry
message, stream = Odometry(), io.BytesIO()
message.header.frame_id, message.pose.pose.position.x = "odom", 1.5
message.serialize(stream)
again = Odometry().deserialize(stream.getvalue())
print(again.header.frame_id, again.pose.pose.position.x, again == message)
"""
    assert output(code) == ["odom", "1.5", "True"]


def test_every_package_has_the_names_it_has_without():
    code = (
        f"import importlib, inspect; print(*(f'{{package}}.{{kind}}.{{name}}' for package in {PACKAGES} "
        "for kind in ('msg', 'srv') if importlib.util.find_spec(f'{package}.{kind}') "
        "for name, kept in inspect.getmembers(importlib.import_module(f'{package}.{kind}'), inspect.isclass)))"
    )
    plain = output(code, "import importlib.util; ")
    assert len(plain) > 100 and output(code) == plain


def test_what_a_package_does_not_have_is_missed_as_ever():
    code = """
import std_msgs.msg
print(hasattr(std_msgs.msg, "Nonsense"))
try:
    from std_msgs.msg import Nonsense
except ImportError:
    print("missed")
"""
    assert output(code) == ["False", "missed"]


def test_a_package_that_does_more_than_hold_messages_is_left_alone(tmp_path):
    package = tmp_path / "my_msgs" / "msg"
    package.mkdir(parents=True)
    (tmp_path / "my_msgs" / "__init__.py").write_text("")
    (package / "_Mine.py").write_text("class Mine: pass\n")
    (package / "__init__.py").write_text("from ._Mine import *\nLIMIT = 3\n")
    code = f"sys.path.insert(0, {str(tmp_path)!r}); import my_msgs.msg as mine; print(mine.LIMIT, mine.Mine.__name__)"
    assert output(code) == ["3", "Mine"]
