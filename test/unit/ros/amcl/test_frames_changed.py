"""What amcl does where it is told, while it runs, which frames the robot has."""

import threading
from types import SimpleNamespace

import numpy as np

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.amcl.node import AmclNode
from mbf_relay.scan import LaserScan

PLACE = Pose2D(1.0, 2.0, 0.5)


def test_a_robot_whose_odometry_frame_is_corrected_while_it_drives_stays_where_it_is():
    data = np.zeros((100, 100), dtype=np.int8)
    data[:1] = data[-1:] = data[:, :1] = data[:, -1:] = 100
    node = AmclNode.__new__(AmclNode)
    node._parameters, node._lock = AmclParameters(), threading.RLock()
    node._map_to_odom = SimpleNamespace(configure=lambda *_: None)
    node._localizer = Localizer(node._parameters, OccupancyMap(data, 0.05, IDENTITY), np.random.default_rng(1))
    node._localizer.set_initial_pose(PLACE, np.diag([1e-4, 1e-4, 1e-4]))
    scan = LaserScan(np.full(8, np.inf), 0.0, 0.7, 0.1, 3.0, 1.0, "laser")
    node._odom_pose = Pose2D(0.0, 0.0, 0.0)
    node._localizer.process(node._odom_pose, scan, IDENTITY)
    node._reconfigure(node._parameters.replace(odom_frame_id="odom_combined"))
    assert node.pose() is None
    node._odom_pose = Pose2D(1.5, -0.75, 2.0)
    node._localizer.process(node._odom_pose, scan, IDENTITY)
    assert node.pose().distance_to(PLACE) < 0.05
    node._reconfigure(node._parameters.replace(transform_tolerance=0.2))
    assert node.pose() is not None
