"""Two lidars on one topic: what one of them sees says nothing of the other."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped, Twist, Vector3
from nav_msgs.msg import Odometry
from ros_testing import as_received
from scan_source import StillFrames, scan_source
from sensor_msgs.msg import LaserScan

from mbf_relay.control.velocity_guard import OBSTACLE
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.geometry import IDENTITY, STOP
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.frame_tree import FrameTree
from mbf_relay.ros.common.odometry import RawOdometry
from mbf_relay.ros.costmap import inputs
from mbf_relay.ros.velocity_guard import lidars as guards_lidars
from mbf_relay.ros.velocity_guard import node

BEAMS = 180


def scan_of(frame, ranges, stamp=1.0):
    """Return a scan of half a turn; readings (m), or one for all."""
    message = LaserScan(angle_min=-math.pi / 2, angle_increment=math.pi / BEAMS, range_min=0.1, range_max=3.5)
    message.header.frame_id, message.ranges = frame, np.broadcast_to(ranges, BEAMS)
    message.header.stamp = inputs.rospy.Time.from_sec(stamp)
    return message


@pytest.fixture
def lidars(monkeypatch):
    """Return a costmap and a function that has a lidar send readings at a time."""
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    costmap, sensor = scan_source(StillFrames(), patience=0.2)
    monkeypatch.setattr(sensor, "_say", lambda reason: None)

    def send(stamp, frame, ranges, *more):
        for now, whose in ((stamp, frame), *more):
            monkeypatch.setattr(inputs.rospy, "get_time", lambda now=now: now)
            sensor._keep(scan_of(whose, ranges, now))
        sensor.feed(now)
        costmap.update(now, IDENTITY)

    return costmap, send


def test_a_scan_that_is_refused_while_its_source_is_being_made_is_named(monkeypatch):
    """The log had an AttributeError in place of the lidar's trouble."""
    def eager(_topic, _kind, take, **_):
        take(scan_of("laser", 1.0, stamp=1.0))

    monkeypatch.setattr(inputs.rospy, "Subscriber", eager)
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: 100.0)
    _, sensor = scan_source(StillFrames(), patience=0.2)
    assert "on topic '/scan'" in sensor.trouble and "99" in sensor.trouble


class Mountings:
    """Where lidars sit (rad), told to who listens: by /tf what stands in the map or is said to move."""

    def __init__(self):
        self.told, self.moved, self._known = {"front": 0.0}, {"map": 0.0}, {}
        self.is_heard = True
        self._tree = FrameTree(lambda *_: True)
        for parent, child in (("map", "odom"), ("odom", "base_link"), ("base_link", "pan"), ("odom", "post")):
            self._tree.add(parent, child, "/driver", now=1.0)

    def frames_above(self, base, frame):
        return self._tree.above(base, frame)

    def listen(self):
        self.is_heard = True

    def rest(self):
        self.is_heard = False

    @staticmethod
    def rides_on(_base, frame):
        return frame != "map"

    def lookup_message(self, _base, frame, max_age):
        self._known.update(self.told)
        if self.is_heard:
            self._known.update(self.moved)
        if frame not in self._known:
            raise TransformError(f"no transform from '{frame}'")
        message = TransformStamped()
        message.header.stamp.secs = int(frame in self.moved)
        message.transform.rotation.z = math.sin(self._known[frame] / 2.0)
        message.transform.rotation.w = math.cos(self._known[frame] / 2.0)
        return message


@pytest.fixture
def guard(monkeypatch):
    """Return a guard node whose robot is asked to drive ahead."""
    for name in ("Publisher", "Subscriber"):
        monkeypatch.setattr(inputs.rospy, name, lambda *_, **__: SimpleNamespace(
            publish=lambda message: None, get_num_connections=lambda: 1, resolved_name="/cmd_vel"))
    monkeypatch.setattr(inputs.rospy, "resolve_name", lambda name: f"/{name}")
    for name in ("loginfo_throttle", "logwarn_throttle"):
        monkeypatch.setattr(inputs.rospy, name, lambda period, text: None)
    monkeypatch.setattr(node, "on_shutdown", lambda function: None)
    monkeypatch.setattr(guards_lidars, "Transforms", Mountings)
    monkeypatch.setattr(node.diagnostics, "Diagnostics", lambda: SimpleNamespace(add=lambda name, report: None))
    footprint = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
    made = node.VelocityGuardNode(VelocityGuardParameters(footprint=footprint))
    made._clock = SimpleNamespace(note=lambda now: None, stands=False)  # the tests' time goes by steps
    return made


def asked(guard, speed, *scans):
    """Return the speed that passes after scans of one moment."""
    for message in scans:
        guard._take_scan(message)
    guard._take_command(Twist(linear=Vector3(x=speed)))
    guard._step(1.0)
    return guard._verdict.velocity.x


def test_a_wall_ahead_is_guarded_against_where_two_lidars_send_at_one_moment(guard):
    """The one that came last displaced the other, and where they keep time it was always the same."""
    guard._lidars._transforms.told["rear"] = math.pi
    for _ in range(2):
        passed = asked(guard, 0.2, scan_of("front", 0.12), scan_of("rear", 3.0))
    assert passed < 0.05 and guard._verdict.cause == OBSTACLE


def test_a_lidar_whose_place_is_told_later_is_looked_at_from_then_on(guard):
    """The guard listened to no transform any more once it had placed the first one."""
    assert asked(guard, -0.2, scan_of("front", 3.0)) > -0.2, "nothing looks back"
    guard._lidars._transforms.moved["rear"] = math.pi
    for _ in range(2):
        passed = asked(guard, -0.2, scan_of("front", 3.0), scan_of("rear", 3.0))
    assert passed == -0.2


def test_a_wall_is_guarded_against_where_the_lidar_looks_since_it_was_turned(guard):
    """It sat for good where it had been when the first scan came."""
    ranges = np.full(BEAMS, 3.0)
    ranges[:10] = 0.12  # on the right
    assert asked(guard, 0.2, scan_of("front", ranges)) == 0.2 and not guard._lidars._transforms.is_heard
    guard._lidars._transforms.told["front"] = math.pi / 2.0
    assert asked(guard, 0.2, scan_of("front", ranges, 1.01)) < 0.05 and guard._verdict.cause == OBSTACLE


def test_a_robot_stands_while_its_clock_does_though_nothing_comes_that_could_be_judged(guard):
    """In a time that stood no silence of the driver's and no scan's age ever grew: the wheels rolled on by the last."""
    assert asked(guard, 0.2, scan_of("front", 3.0)) == 0.2
    guard._clock.stands = True
    guard._step(1.0)
    assert guard._verdict.velocity == STOP and "time stands at 1.00 s" in guard._verdict.text
    guard._clock.stands = False
    assert asked(guard, 0.2) == 0.2


def test_the_guard_drives_on_when_a_lidar_that_stands_in_the_world_falls_silent(guard):
    """A few scans in the frame 'map' counted as a lidar of the robot's, and it stood until a restart."""
    for _ in range(2):
        asked(guard, 0.2, scan_of("front", 3.0, 1.0), scan_of("map", 3.0, 1.0))
    assert guard._lidars._transforms.is_heard, "/tf says where it is"
    for stamp in (2.0, 3.0, 4.0):
        guard._take_scan(scan_of("front", 3.0 - 0.01 * stamp, stamp))
        guard._take_command(Twist(linear=Vector3(x=0.2)))
        guard._step(stamp)
        assert guard._verdict.velocity.x == 0.2, guard._verdict.text
    assert not guard._lidars._transforms.is_heard, "nothing moves on the robot"
    guard._take_scan(scan_of("map", 2.0, 5.5))
    guard._take_command(Twist(linear=Vector3(x=0.2)))
    guard._step(5.5)
    assert guard._verdict.velocity.x == 0.0, "one that stands in the world is none in the robot's stead"


@pytest.mark.parametrize("base, lidar, speed", [
    ("odom", "pan", 0.0), ("/map", "pan", 0.0), ("base_link", "pan", 0.2), ("base_link", "post", 0.2)])
def test_a_guard_whose_base_is_not_the_robots_lets_nothing_pass(guard, monkeypatch, base, lidar, speed):
    """With `base_frame: odom` it looked for obstacles round where the robot had begun, for as long as that was near."""
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: 1.0)
    guard._lidars._base_frame = base
    guard._lidars._transforms.moved[lidar] = 0.0
    odometry = Odometry()
    odometry.header.frame_id, odometry.header.stamp = "odom", inputs.rospy.Time.from_sec(1.0)
    guard._odometry._take(as_received(odometry, RawOdometry))
    assert asked(guard, 0.2, scan_of(lidar, 3.0)) == speed
    assert (f"base_frame is {base.strip('/')}, in which the robot moves" in guard._report()[1]) == (speed == 0.0)


def test_a_guard_that_nobody_listens_to_says_why_the_robot_does_not_move(guard, monkeypatch):
    """The log had only that the robot stood still against its commands."""
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: 1.0)
    guard._velocity.get_num_connections = lambda: 0
    assert asked(guard, 0.2, scan_of("front", 3.0)) == 0.2
    level, text, _values = guard._report()
    assert level == node.diagnostics.WARN
    assert text == "passing (to nobody: no reachable node subscribes to /cmd_vel)"
    assert asked(guard, 0.0) == 0.0 and guard._report()[0] == node.diagnostics.OK, "one that stands needs nobody"


@pytest.mark.parametrize("odometry", ["none", "broken", "old", "not a number", "as told", "late"])
def test_a_guard_drives_on_whatever_odometry_is_and_learns_from_what_is_sound_how_late_wheels_are(
        guard, monkeypatch, odometry):
    for step in range(1, 60):
        now, speed = 10.0 + 0.1 * step, 0.2 + 0.05 * math.sin(0.5 * step)
        monkeypatch.setattr(inputs.rospy, "get_time", lambda now=now: now)
        message = Odometry()
        message.header.stamp = inputs.rospy.Time.from_sec(now - 2.0 * (odometry == "old"))
        late = step - (11 if odometry != "as told" else 1)
        message.twist.twist.linear.x = 0.2 + 0.05 * math.sin(0.5 * late) if late > 0 else 0.0
        if odometry == "not a number":
            message.twist.twist.linear.x = math.nan
        if odometry != "none":
            guard._odometry._take(as_received(message, RawOdometry))
        if odometry == "broken":
            guard._odometry._newest[0].bytes = b"broken"
        guard._take_scan(scan_of("front", 3.0 - 0.001 * step, now))
        guard._take_command(Twist(linear=Vector3(x=speed)))
        guard._step(now)
        assert guard._verdict.velocity.x == pytest.approx(speed), guard._verdict.text
    told = float(guard._report()[2]["velocities take effect after [s]"])
    assert told == (pytest.approx(1.0, abs=0.1) if odometry == "late" else 0.0)


def test_a_fast_lidar_does_not_displace_a_slow_one_before_the_next_update(lidars):
    costmap, send = lidars
    for stamp, frame in [(0.1, "slow"), (0.11, "fast"), (0.12, "slow")]:
        send(stamp, frame, np.full(BEAMS, 2.0))
    send(0.2, "slow", np.full(BEAMS, 1.0), *((0.2 + 0.01 * count, "fast") for count in range(1, 9)))
    assert costmap.layers[0]._sources["scan"].sensors["slow"].last_update == 0.2


def test_a_robot_does_not_drive_on_when_the_front_one_of_its_two_lidars_delivers_nothing(lidars):
    costmap, send = lidars
    for count in range(1, 8):
        stamp = 0.2 * count
        send(stamp, "front", np.full(BEAMS, 2.0 if count < 5 else 0.0))
        if count >= 5:
            assert ("measures nothing in 100 % of its beams (the one of 2 in frame 'front'; if it was taken away for "
                    "good, start this node again)") in costmap.stale_reason(stamp)
        send(stamp + 0.05, "rear", np.full(BEAMS, 1.0))
        assert (costmap.stale_reason(stamp + 0.05) is None) == (count < 5)
    send(1.6, "front", np.full(BEAMS, 2.0))
    assert costmap.stale_reason(1.6) is None


def test_goals_are_driven_to_after_a_lidar_that_stands_in_the_world_fell_silent(lidars):
    """A few scans in the frame 'map' counted as a lidar of the robot's, and no goal was driven to until a restart."""
    costmap, send = lidars
    for count in range(1, 30):
        stamp = 0.2 * count
        send(stamp, "front", np.full(BEAMS, 2.0))
        if count < 8:
            send(stamp + 0.05, "map", np.full(BEAMS, 0.5))
            assert (costmap.snapshot().costs == 254).any(), "what it sees stands in the way"
        assert costmap.stale_reason(stamp + 0.05) is None
    assert len(costmap.layers[0]._sources["scan"].kept) == 1, "what it saw once does not come back for ever"


def test_a_robot_whose_own_lidar_is_silent_does_not_drive_by_one_that_stands_in_the_world(lidars):
    costmap, send = lidars
    for count in range(1, 20):
        stamp = 0.2 * count
        if count < 8:
            send(stamp, "front", np.full(BEAMS, 2.0))
        send(stamp + 0.05, "map", np.full(BEAMS, 2.0))
    assert "sent nothing" in costmap.stale_reason(stamp)
