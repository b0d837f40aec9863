"""Where amcl starts: at the pose that was kept, moved by odometry since, unless somebody says another one first."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_srvs.srv import EmptyRequest, TriggerRequest

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.estimate import Estimate
from mbf_relay.localization.kept_pose import KeptPose
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.localization.scan_search import Places
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.amcl.initial_pose import initial_pose_from_message
from mbf_relay.ros.amcl.node import AmclNode
from mbf_relay.ros.common.conversions import pose_to_message

PLACE, OTHER = Pose2D(1.0, 2.0, 0.5), Pose2D(3.0, 3.5, -1.0)
SURE = np.diag([1e-4, 1e-4, 1e-4])


@pytest.fixture
def node(monkeypatch):
    """An amcl of paper on an empty floor, with a pose kept when odometry was at 0, and half a metre driven since."""
    for name in ("loginfo", "logwarn"):
        monkeypatch.setattr(rospy, name, lambda *_: None)
    made = AmclNode.__new__(AmclNode)
    made._parameters, made._lock, made._rng = AmclParameters(), threading.RLock(), np.random.default_rng(1)
    made._map_to_odom, made._start_anywhere = SimpleNamespace(configure=lambda *_: None), False
    made._covariance, made._pending_pose, made._newest_scan = np.eye(3), None, None
    made._odom_pose = Pose2D(0.5, 0.0, 0.0)
    floor = OccupancyMap(np.zeros((100, 100), np.int8), 0.05, IDENTITY)
    made._start_on(floor, (PLACE, SURE, KeptPose(PLACE, IDENTITY, 1.0)))
    return made


def place_of(node):
    """Return the middle of the particles and how far they lie apart (m)."""
    return Pose2D(*node._localizer.poses.mean(axis=0)), node._localizer.poses[:, :2].std(axis=0).max()


def test_a_restarted_robot_is_where_it_has_driven_since_and_as_sure_of_that_as_before(node):
    node._resume(9.0)
    place, spread = place_of(node)
    assert place.distance_to(PLACE.compose(Pose2D(0.5, 0.0, 0.0))) < 0.01 and spread < 0.02


def test_what_was_kept_is_taken_up_once_and_not_at_every_scan(node):
    node._resume(9.0)
    node._localizer.set_initial_pose(OTHER, SURE)
    node._resume(9.0)
    assert place_of(node)[0].distance_to(OTHER) < 0.01


def test_who_says_before_the_first_scan_where_the_robot_is_is_believed(node):
    node._start_at(OTHER, SURE, False)
    node._resume(9.0)
    assert place_of(node)[0].distance_to(OTHER) < 0.01


def test_who_asks_before_the_first_scan_to_look_everywhere_has_that_done(node):
    node._globalize(EmptyRequest())
    node._resume(9.0)
    assert place_of(node)[1] > 1.0


def test_a_robot_whose_scan_fits_nowhere_stays_where_it_is_taken_to_be(node, monkeypatch):
    monkeypatch.setattr(node._localizer, "find", lambda *_: Places(np.empty((0, 3)), np.empty(0)))
    node._newest_scan, node._scan_watch = (None, IDENTITY), SimpleNamespace(warn_of_search=lambda share: None)
    answer = node._relocalize(TriggerRequest())
    assert not answer.success and "fits nowhere" in answer.message
    assert place_of(node)[0].distance_to(PLACE) < 0.01


def test_how_sure_it_is_of_place_and_heading_is_told_where_others_look_for_it(node):
    told = []
    node._pose_publisher, node._cloud_publisher = (SimpleNamespace(publish=told.append) for _ in range(2))
    covariance = np.arange(9.0).reshape(3, 3)
    node._publish(Estimate(PLACE, covariance, 1.0, 1), np.zeros((1, 3)), rospy.Time(1))
    six = np.array(told[0].pose.covariance).reshape(6, 6)
    assert (six[np.ix_((0, 1, 5), (0, 1, 5))] == covariance).all() and np.count_nonzero(six) == 8


def test_a_pose_of_the_past_is_moved_on_as_the_robot_has_driven_and_no_more_is_read_of_it_than_amcl_does():
    message = PoseWithCovarianceStamped()
    message.pose.pose, message.pose.covariance = pose_to_message(PLACE), np.arange(36.0).tolist()
    pose, covariance = initial_pose_from_message(message, Pose2D(0.5, 0.1, 0.2))
    assert pose == pytest.approx(PLACE.compose(Pose2D(0.5, 0.1, 0.2)))
    assert covariance.tolist() == [[0.0, 1.0, 0.0], [6.0, 7.0, 0.0], [0.0, 0.0, 35.0]]
