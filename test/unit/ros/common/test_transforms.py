"""Where the robot is, asked of transforms that wait to be read."""

import io
import math
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common import transforms
from mbf_relay.ros.common.clouds import rigid
from mbf_relay.ros.common.conversions import header, transform_to_message
from mbf_relay.ros.common.lidar_geometry import mounting_of
from mbf_relay.ros.common.tf_buffer import UnreadTransforms


class Robot:
    """Sends where it is, and is asked."""

    def __init__(self, monkeypatch):
        self.subscribed, self.now, self.changes = {}, 10.0, 0
        self.connected = {"/tf": [], "/tf_static": []}
        monkeypatch.setattr("rosgraph.Master.lookupService", lambda *_: "")  # tf2 asks the master for its own service
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "get_time", lambda: self.now)
        monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time.from_sec(self.now))
        self.transforms = transforms.Transforms(changed=self._note)

    def _subscribe(self, topic, message_class, callback, **_options):
        self.subscribed[topic] = message_class, callback
        return SimpleNamespace(
            unregister=lambda: self.subscribed.pop(topic), impl=SimpleNamespace(connections=self.connected[topic]))

    def leave(self, sender):
        """End a node."""
        for links in self.connected.values():
            links[:] = [link for link in links if link.callerid_pub != sender]

    def _note(self):
        self.changes += 1

    def send(self, x, topic="/tf", child="base", stamp=None, text=None, sender="/wheels", parent="odom"):
        message_class, callback = self.subscribed[topic]
        if text is None:
            stamp = self.now if stamp is None else stamp
            text = written(TFMessage([TransformStamped(
                header(parent, stamp), child, transform_to_message(Pose2D(x, 0.0, 0.0)))]))
        message = message_class().deserialize(text)
        message._connection_header = {"callerid": sender}
        if all(link.callerid_pub != sender for link in self.connected[topic]):
            self.connected[topic].append(SimpleNamespace(callerid_pub=sender, endpoint_id=""))
        callback(message)

    def x(self, child="base", stamp=None):
        return self.transforms.lookup("odom", child, stamp).x


def written(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


@pytest.fixture
def robot(monkeypatch):
    return Robot(monkeypatch)


def test_the_pose_asked_for_is_the_newest_that_came(robot):
    for step in range(5):
        robot.now += 0.1
        robot.send(float(step))
    assert robot.x() == 4.0 and robot.x(stamp=10.2) == 1.0
    assert robot.changes == 5


def test_who_only_asks_whether_a_pose_is_known_hears_of_what_has_just_come(robot):
    assert not robot.transforms.can_transform("odom", "base", 10.0)
    robot.send(1.0)
    assert robot.transforms.can_transform("odom", "base", 10.0)


def test_a_stamp_is_judged_by_when_it_came_not_by_when_somebody_asks(robot):
    robot.send(1.0)
    robot.now += 0.1
    robot.send(2.0, stamp=robot.now + 5.0)
    robot.now += 5.0
    assert robot.x() == 1.0, "it was dated five seconds ahead"


def test_who_is_refused_a_late_pose_is_told_of_what_age_it_is_and_what_allows_more(robot):
    robot.send(1.0, stamp=robot.now)
    robot.now += 1.4
    with pytest.raises(TransformError, match=r"'base' to 'odom' is 1.40 s old; at most 1.00 s allowed \(~age\)"):
        robot.transforms.lookup("odom", "base", max_age=1.0, named="~age")


@pytest.mark.parametrize("behind, silent, differ", [(1.4, 0.1, True), (0.1, 1.3, False)])
def test_who_is_refused_a_pose_of_another_clock_is_told_so_and_not_where_its_sender_fell_silent(
        robot, behind, silent, differ):
    """A robot's computer without a clock of its own was told again and again that its transform was 4.02 s old."""
    for _ in range(5):
        robot.now += 0.1
        robot.send(1.0, stamp=robot.now - behind)
    robot.now += silent
    with pytest.raises(TransformError, match="is 1.[45]0 s old; at most 1.00 s allowed") as refused:
        robot.transforms.lookup("odom", "base", max_age=1.0)
    assert ("when it came: two clocks differ" in str(refused.value)) == differ


def test_whose_clock_is_far_ahead_is_told_why_there_is_no_pose_until_the_clock_is_set(robot):
    """All that was said was that "odom" passed to lookupTransform does not exist."""
    robot.send(1.0, stamp=robot.now + 4.0)
    words = "no transform from 'base' to 'odom': .*; the transform of 'base' was refused: .* 4.00 s ahead .*: two clock"
    with pytest.raises(TransformError, match=words):
        robot.transforms.lookup("odom", "base")
    robot.send(1.0)
    assert robot.x() == 1.0
    with pytest.raises(TransformError) as unknown:
        robot.transforms.lookup("map", "base")
    assert "refused" not in str(unknown.value)


def test_nobody_drives_by_a_pose_of_before_time_was_set_back_where_none_has_come_since(robot):
    robot.now = 1000.0
    robot.send(1.0, stamp=1002.0)  # as amcl's, which is dated ahead
    assert robot.transforms.lookup("odom", "base", max_age=0.5).x == 1.0
    robot.now = 5.0
    with pytest.raises(TransformError, match="'base' to 'odom' is of before time was set back by 997.00 s"):
        robot.transforms.lookup("odom", "base", max_age=0.5)


def test_where_time_is_set_back_nothing_is_left_of_before(robot):
    robot.send(1.0)
    robot.x()
    robot.now += 1.0
    robot.send(2.0)
    robot.now = 3.0
    robot.send(0.0, child="arm")
    with pytest.raises(TransformError):
        robot.x()
    robot.send(5.0)
    assert robot.x() == 5.0


def test_a_message_that_cannot_be_read_takes_no_other_with_it(robot):
    robot.send(1.0)
    robot.now += 0.1
    robot.send(0.0, text=b"\x05\x00\x00\x00broken")
    robot.send(2.0)
    assert robot.x() == 2.0


def test_what_nobody_asks_for_does_not_pile_up(robot):
    for _ in range(10 * transforms.MOST_PENDING):
        robot.now += 0.01
        robot.send(1.0)
    assert len(robot.transforms._listener._pending) <= transforms.MOST_PENDING


def test_where_the_lidar_sits_is_known_whatever_its_stamp(robot):
    robot.send(0.3, topic="/tf_static", child="lidar", stamp=2.0 ** 31)
    assert robot.x("lidar") == 0.3


def test_a_sensor_whose_place_was_told_by_two_digits_sees_nothing_farther_away_than_it_is(robot):
    """tf2 lets pass what is a rotation but for half a percent: a camera saw all of it 0.8 % too far away."""
    place = Transform(Vector3(0.1, 0.0, 0.2), Quaternion(0.0, 0.0, 0.71, 0.71))
    robot.send(0.0, "/tf_static", text=written(TFMessage([TransformStamped(header("base", 0.0), "camera", place)])))
    found = robot.transforms.lookup_message("base", "camera")
    assert rigid(found)[0] @ np.array([3.0, 0.0, 0.0]) == pytest.approx([0.0, 3.0, 0.0], abs=1e-9)
    assert mounting_of(found.transform)[0].theta == pytest.approx(0.5 * math.pi)


def test_others_in_the_process_read_the_same_message_as_ever():
    sent = TFMessage([TransformStamped(header("odom", 3.0), "base", transform_to_message(Pose2D(1.0, 2.0, 0.5)))])
    read = UnreadTransforms().deserialize(written(sent))
    assert read.transforms == sent.transforms and written(read) == written(sent)
    assert UnreadTransforms().transforms == []


def test_a_robot_knows_its_place_after_one_message_hung_its_odometry_on_it(robot):
    robot.send(1.0)
    message_class, callback = robot.subscribed["/tf"]
    wrong = TransformStamped(header("base", robot.now), "odom", transform_to_message(Pose2D(5.0, 0.0, 0.0)))
    message = message_class().deserialize(written(TFMessage([wrong])))
    message._connection_header = {"callerid": "/intruder"}
    callback(message)
    robot.now += 100.0
    robot.send(2.0)
    assert robot.x() == 2.0
    assert robot.transforms.lookup("base", "odom").x == -2.0


@pytest.mark.parametrize("name", ["ba\0se", "", "/", pytest.param("a" * 2000000, id="endless")])
def test_a_name_that_no_frame_can_have_is_refused_in_a_sentence(robot, name):
    """A goal in a frame of two million characters filled the log with three lines of four megabytes."""
    robot.send(1.0)
    with pytest.raises(TransformError, match="names no frame") as refusal:
        robot.x(name)
    assert len(str(refusal.value)) < 300
    assert not robot.transforms.can_transform("odom", name)
    robot.send(2.0, child=name)
    assert robot.x() == 1.0


@pytest.fixture
def told(monkeypatch):
    """What is warned of."""
    told = []
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda _period, text: told.append(text))
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: told.append(text % values))
    return told


def test_of_two_nodes_that_broadcast_one_transform_one_is_believed_and_both_are_named(robot, told):
    """A robot whose odometry came from two nodes drove by both in turn, and was said to be stuck."""
    for _ in range(10):
        robot.now += 0.1
        robot.send(1.0)
        robot.send(2.0, sender="/ekf")
        assert robot.x() == 1.0
    assert len(told) == 10
    assert all(part in told[0] for part in ("/ekf says that 'base' hangs on 'odom'", "/wheels says where it is"))


@pytest.mark.parametrize("x, ahead", [(math.nan, 0.0), (1e8, 0.0), (2.0, 10.0), (2.0, 2.0 ** 31)])
def test_a_robot_is_where_it_was_while_what_comes_means_nothing_or_is_of_another_time(robot, x, ahead):
    robot.send(1.5)
    robot.now += 0.1
    robot.send(x, stamp=robot.now + ahead)
    assert robot.x() == 1.5


@pytest.mark.parametrize("is_heard", [False, True], ids=["it ended", "it is silent"])
def test_who_takes_the_place_of_a_broadcaster_is_believed(robot, told, is_heard):
    robot.send(1.0)
    robot.now += 0.1
    if is_heard:
        robot.now += 2.0
    else:
        robot.leave("/wheels")
    robot.send(2.0, sender="/ekf", parent="odom_combined")
    robot.send(3.0, sender="/ekf", parent="odom", child="odom_combined")
    assert robot.x() == 5.0 and told == []


@pytest.mark.parametrize("parent", ["map", "odom"])
@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_a_stranger_who_puts_the_lidar_elsewhere_is_not_believed_and_named(robot, told, topic, parent):
    """One message by which 'base_scan' hung on 'map' left amcl without a scan until it was started again."""
    robot.send(7.0, parent="map", child="odom")
    robot.send(1.0, sender="/description", topic="/tf_static", child="lidar")
    robot.send(9.0, sender="/stranger", topic=topic, parent=parent, child="lidar")
    assert robot.x("lidar") == 1.0
    assert len(told) == 1 and f"/stranger says that 'lidar' hangs on '{parent}'" in told[0]
    assert "/description says where it is on 'odom'" in told[0]


@pytest.mark.parametrize("first, then", [("/tf", "/tf_static"), ("/tf_static", "/tf")])
def test_a_lidar_is_known_again_once_a_stranger_who_was_first_has_gone(robot, first, then):
    """tf2 never lets a frame that one of the two topics told of become one of the other's."""
    robot.send(7.0, sender="/stranger", topic=first, parent="map", child="lidar")
    robot.send(4.0, topic="/tf_static", child="mast")
    assert robot.transforms.can_transform("map", "lidar")
    robot.leave("/stranger")
    robot.send(1.0, sender="/description", topic=then, child="lidar")
    robot.now += 100.0
    if then == "/tf":
        robot.send(1.0, sender="/description", topic=then, child="lidar")
    assert robot.x("lidar", stamp=robot.now) == 1.0
    assert robot.x("mast") == 4.0


def test_a_robot_knows_its_place_once_a_stranger_who_hung_it_upside_down_is_silent(robot):
    robot.send(5.0, sender="/stranger", parent="base", child="odom")
    robot.send(1.0)
    robot.now += 3.0
    robot.send(2.0)
    assert robot.x() == 2.0


def test_an_odometry_that_a_stranger_had_fixed_to_the_robot_moves_again_once_he_has_gone(robot):
    """tf2 went on taking what amcl said of it for fixed: for true at any time, and never too old."""
    robot.send(5.0, sender="/stranger", topic="/tf_static", parent="base", child="odom")
    robot.leave("/stranger")
    robot.send(1.0)
    for x in (7.0, 9.0):
        robot.send(x, sender="/amcl", parent="map", child="odom")
        robot.now += 0.5
    assert robot.transforms.lookup("map", "odom", stamp=robot.now - 1.0).x == 7.0
    robot.now += 100.0
    with pytest.raises(TransformError, match="old; at most"):
        robot.transforms.lookup("map", "odom", max_age=1.0)


def test_who_moves_a_lidar_that_it_placed_itself_is_believed_and_told_of(robot, told):
    for x in (0.3, 0.3, 0.1):
        robot.send(x, topic="/tf_static", child="lidar")
        assert robot.x("lidar") == x
    assert len(told) == 1 and "x 0.300 m" in told[0] and "x 0.100 m" in told[0] and "/wheels has moved" in told[0]


def test_of_two_nodes_that_place_a_lidar_alike_nothing_is_said(robot, told):
    for sender in ("/description", "/description_2"):
        robot.send(0.3, topic="/tf_static", child="lidar", sender=sender, stamp=robot.now)
        robot.now += 0.1
    assert robot.x("lidar") == 0.3 and told == []


def test_a_lidar_that_stands_in_the_world_is_told_from_one_that_the_robot_carries(robot):
    """Whatever sent a scan in the frame 'map' counted as a lidar of the robot's."""
    for parent, child in (("map", "odom"), ("odom", "footprint"), ("base", "pan")):
        robot.send(0.0, parent=parent, child=child)
    fixed = (("footprint", "base"), ("footprint", "low"), ("base", "high"), ("map", "wall"), ("pan", "eye"))
    for parent, child in fixed:
        robot.send(0.0, topic="/tf_static", parent=parent, child=child)
    rides = {frame for frame in ("map", "odom", "wall", "footprint", "base", "low", "high", "pan", "eye", "/low", "no")
             if robot.transforms.rides_on("/base", frame)}
    assert rides == {"footprint", "base", "low", "high", "pan", "eye", "/low", "no"}
    assert "odom" in robot.transforms.frames_above("base", "map")
    assert "odom" not in robot.transforms.frames_above("base", "low")


def test_who_listens_to_what_is_fixed_alone_hears_of_it_and_may_listen_again(robot):
    robot.transforms.rest()
    assert list(robot.subscribed) == ["/tf_static"]
    for x in (0.3, 0.1):
        robot.send(x, topic="/tf_static", child="lidar")
        assert robot.x("lidar") == x
    robot.now += 100.0
    assert robot.transforms.lookup("lidar", "lidar", max_age=1.0).x == 0.0, "scans may come in the robot's own frame"
    robot.transforms.listen()
    robot.send(1.0)
    assert robot.x() == 1.0
    robot.transforms.close()
    assert not robot.subscribed


def test_who_sends_a_transform_twice_does_not_fill_the_terminal(robot, capfd):
    for stamp in (10.0, 10.0, 10.0):
        robot.send(1.0, stamp=stamp)
        assert robot.x() == 1.0
    robot.now = 10.1
    robot.send(2.0)
    assert robot.x() == 2.0
    assert "TF_" not in capfd.readouterr().err


def test_a_robot_of_two_broadcasters_that_speak_at_once_knows_where_it_was(robot, monkeypatch):
    """Each has a thread: the one that had looked at the clock, and went on after the other, found time set back."""
    robot.send(1.0, stamp=9.0)
    assert robot.x(stamp=9.0) == 1.0
    other = threading.Thread(target=lambda: robot.send(0.0, child="laser", stamp=10.1, sender="/lidar"))

    def looks_and_waits():
        monkeypatch.setattr(rospy, "get_time", lambda: 10.1)
        other.start()
        other.join(0.5)
        return 10.0

    monkeypatch.setattr(rospy, "get_time", looks_and_waits)
    robot.send(2.0, stamp=10.0)
    other.join()
    assert robot.x(stamp=9.0) == 1.0 and robot.x() == 2.0
