"""A bag made by hand and the drive read back from it; runs where ROS's message packages are."""

import math

import numpy as np
import pytest
from readmes import ROOT

rosbag = pytest.importorskip("rosbag")

import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist, TwistStamped
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.ros.common import conversions
from mbf_relay.ros.tools import drive_report
from mbf_relay.ros.tools.drive_events import DriveEvents, read_bag
from mbf_relay.ros.web import recording


def transform(parent, child, pose, stamp):
    return TransformStamped(conversions.header(parent, stamp), child, conversions.transform_to_message(pose))


def write_bag(path, with_truth=True, nan_truths=()):
    """Five seconds along y of the map at 0.2 m/s: the odom frame is turned by a quarter."""
    map_from_odom = Pose2D(1.0, 2.0, math.pi / 2.0)
    with rosbag.Bag(path, "w") as bag:
        static = TFMessage([transform("base_footprint", "base_scan", Pose2D(-0.03, 0.0, 0.0), 1.0)])
        bag.write("/tf_static", static, rospy.Time.from_sec(1.0))
        goal = MoveBaseActionGoal()
        goal.goal_id.id = "goal"
        goal.goal.target_pose = conversions.pose_stamped(Pose2D(1.0, 3.0, 0.0), "map", 1.0)
        bag.write("/move_base/goal", goal, rospy.Time.from_sec(1.0))
        for step in range(51):
            now = 1.0 + 0.1 * step
            stamp = rospy.Time.from_sec(now)
            pose = Pose2D(0.02 * step, 0.0, 0.0)
            frames = [
                transform("map", "odom", map_from_odom, now + 0.5),
                transform("odom", "base_footprint", pose, now),
            ]
            bag.write("/tf", TFMessage(frames), stamp)
            bag.write("/cmd_vel", conversions.twist_to_message(conversions.Twist2D(0.2, 0.0, 0.0)), stamp)
            scan = LaserScan(header=conversions.header("base_scan", now), angle_min=0.0, angle_increment=1.0,
                             range_min=0.1, range_max=3.5, ranges=[1.0, math.inf, math.nan, 0.0, 3.5])
            bag.write("/scan", scan, stamp)
            if with_truth:
                truth = Odometry(header=conversions.header("map", now))
                truth.pose.pose = conversions.pose_to_message(map_from_odom.compose(pose))
                if step in nan_truths:
                    truth.pose.pose.position.x = math.nan
                bag.write("/ground_truth", truth, stamp)
        bad = Twist()
        bad.linear.x = math.nan
        bag.write("/cmd_vel", bad, stamp)
        bag.write("/planner/plan", PathMessage(conversions.header("map", now), [PoseStamped()]), stamp)
        result = MoveBaseActionResult()
        result.status.goal_id.id, result.status.status, result.status.text = (
            "goal",
            GoalStatus.SUCCEEDED,
            "Goal reached.",
        )
        bag.write("/move_base/result", result, stamp)


def test_a_bag_gives_the_drive_it_holds(tmp_path):
    path = str(tmp_path / "drive.bag")
    write_bag(path)
    drive, topics = read_bag(path)
    figures = drive.summary()
    assert "/tf" in topics and figures["success"] is True
    assert figures["path_length"] == pytest.approx(1.0, abs=1e-6)
    assert figures["localization_error_max"] == pytest.approx(0.0, abs=1e-6)
    assert drive.estimate[-1, 1:] == pytest.approx([1.0, 3.0, math.pi / 2.0])
    assert drive.goals[0].text == "Goal reached."
    assert drive.seen[:, 0] == pytest.approx(1.0) and len(drive.seen) >= 8
    assert drive.seen[-1, 1] - drive.seen[0, 1] == pytest.approx(0.1 * (len(drive.seen) - 1), abs=0.03)
    assert len(drive.commands) == 51


def test_a_drive_of_a_robot_whose_base_is_base_link_is_shown():
    """The report said that the bag shows no drive."""
    events = DriveEvents()
    events.handle("tf_static", TFMessage([transform("base_link", "laser", IDENTITY, 1.0)]), 1.0)
    for now in (1.0, 2.0, 3.0):
        base = transform("odom", "base_link", Pose2D(now, 0.0, 0.0), now)
        wheel = transform("base_link", "wheel", Pose2D(0.1, 0.0, now), now)
        events.handle("tf", TFMessage([transform("map", "odom", IDENTITY, now), base, wheel]), now)
        events.handle("scan", LaserScan(header=conversions.header("laser", now), angle_increment=1.0, range_min=0.1,
                                        range_max=3.5, ranges=[1.0]), now)
    drive = events.drive()
    assert drive.path[:, 1] == pytest.approx([1.0, 2.0, 3.0])
    assert drive.seen[:, 0] == pytest.approx([2.0, 3.0, 4.0])


@pytest.mark.parametrize("topic, message", [
    ("/cmd_vel", TwistStamped()), ("/odom", PoseStamped()), ("/contacts", String()), ("/map", PointCloud2()),
    ("/ground_truth", PoseStamped()), ("/move_base/goal", PoseStamped()), ("/move_base/result", String()),
    ("/scan", PointCloud2(header=conversions.header("base_scan", 3.0))), ("/tf_static", String()),
    ("/planner/plan", String()),
])
def test_another_robot_s_topic_of_another_type_is_left_out_of_the_report(tmp_path, topic, message):
    """One TwistStamped on cmd_vel, or Gazebo's own contacts, ended the report with a traceback."""
    path = str(tmp_path / "drive.bag")
    write_bag(path)
    with rosbag.Bag(path, "a") as bag:
        bag.write(topic, message, rospy.Time.from_sec(3.0))
    drive, _ = read_bag(path)
    assert drive.summary()["success"] is True and len(drive.commands) == 51


@pytest.mark.parametrize("recorded", [
    (ROOT / "launch" / "record.launch").read_text().split(), recording.TOPICS], ids=["launch file", "browser"])
def test_all_that_a_report_tells_is_recorded(recorded):
    """The goals of a client that has paths followed, as mbf_path_client.py does, were not, and the drive had none."""
    topics = {topic.lstrip("/").rstrip('"/>') for topic in recorded}
    assert set(DriveEvents().handlers) <= topics


@pytest.mark.parametrize("planner", ["navfn/NavfnROS", "global_planner/GlobalPlanner"])
def test_the_plans_of_move_base_s_planners_are_recorded(planner):
    """A drive planned by GlobalPlanner had no plan in its report, and nothing said that there was one."""
    recorded = (ROOT / "launch" / "record.launch").read_text().split()
    assert f"move_base/{planner.rpartition('/')[2]}/plan" in recorded


def test_one_of_several_robots_has_a_report_of_its_own_drive(tmp_path, capsys):
    """Of two burgers in one bag there was none: their odometry was not /odom, nor were their frames."""
    alone, path, within = (str(tmp_path / f"{name}.bag") for name in ("alone", "drive", "recorded_in_burger1"))
    write_bag(alone)
    with rosbag.Bag(alone) as read, rosbag.Bag(path, "w") as bag, rosbag.Bag(within, "w") as recorder:
        for topic, message, stamp in read.read_messages():
            for name in ("burger1", "burger2"):
                for each in getattr(message, "transforms", ()):
                    for holder, field in ((each.header, "frame_id"), (each, "child_frame_id")):
                        frame = getattr(holder, field).rpartition("/")[2]
                        setattr(holder, field, frame if frame == "map" else f"{name}/{frame}")
                if topic == "/scan":
                    message.header.frame_id = f"{name}/base_scan"
                own = topic if topic in ("/tf", "/tf_static") else f"/{name}{topic}"
                if name == "burger1" or topic != "/move_base/result":  # the other one never arrives
                    bag.write(own, message, stamp)
                    if name == "burger1":
                        recorder.write(own.replace("/burger1/", ""), message, stamp)
        bag.write("/burger1/odom", Odometry(), stamp)
        bag.write("/burger2/odom", Odometry(), stamp)
    whole = read_bag(alone)[0].summary()
    first, second = (read_bag(path, name)[0].summary() for name in ("burger1", "/burger2/"))
    for name in ("path_length", "success", "localization_error_max"):
        assert first[name] == read_bag(within, "burger1")[0].summary()[name] == pytest.approx(whole[name])
    assert second["path_length"] == pytest.approx(1.0, abs=1e-6) and not second["success"]
    with pytest.raises(SystemExit, match="choose a robot by --namespace, of burger1, burger2"):
        drive_report.main([path])
    drive_report.main([path, "--namespace", "burger1", "--out", str(tmp_path / "out")])
    assert "report.html" in capsys.readouterr().out


def test_without_ground_truth_the_estimate_is_the_path(tmp_path):
    path = str(tmp_path / "drive.bag")
    write_bag(path, with_truth=False)
    figures = read_bag(path)[0].summary()
    assert figures["path_length"] == pytest.approx(1.0, abs=1e-6)
    assert figures["localization_error_mean"] is None


def test_a_client_s_first_goal_that_the_recorder_missed_is_told_by_the_server(tmp_path):
    path = str(tmp_path / "drive.bag")
    with rosbag.Bag(path, "w") as bag:
        for number in range(3):
            for action in ("move_base", "move_base_flex/move_base")[number == 0:]:
                goal = MoveBaseActionGoal()
                goal.goal_id.id = f"{action} {number}"
                goal.goal.target_pose = conversions.pose_stamped(Pose2D(float(number), 0.0, 0.0), "map", 1.0)
                bag.write(f"/{action}/goal", goal, rospy.Time.from_sec(1.0 + number))
    drive, _ = read_bag(path)
    assert [goal.pose.x for goal in drive.goals] == [0.0, 1.0, 2.0]


def test_a_report_of_a_drive_whose_clock_was_set_back_is_of_what_came_after(monkeypatch):
    """The goals, plans, contacts and the seen of before stood in it, with times of before, and a drive of -35 s."""
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
    events = DriveEvents()
    static = TFMessage([transform("base_footprint", "base_scan", Pose2D(-0.03, 0.0, 0.0), 1.0)])
    events.handle("tf_static", static, 39.0)

    def drive(name, began, ends):
        goal = MoveBaseActionGoal()
        goal.goal_id.id = name
        goal.goal.target_pose = conversions.pose_stamped(Pose2D(began, 0.0, 0.0), "map", 1.0)
        events.handle("move_base/goal", goal, began)
        for now in (began, began + 1.0):
            frames = [transform("map", "odom", IDENTITY, now), transform("odom", "base_footprint", IDENTITY, now)]
            events.handle("tf", TFMessage(frames), now)
            events.handle("scan", LaserScan(header=conversions.header("base_scan", now), angle_increment=1.0,
                                            range_min=0.1, range_max=3.5, ranges=[1.0]), now)
            events.handle("cmd_vel", Twist(), now)
            plan = [conversions.pose_stamped(IDENTITY, "map", now)]
            events.handle("planner/plan", PathMessage(conversions.header("map", now), plan), now)
        if ends:
            result = MoveBaseActionResult()
            result.status.goal_id.id, result.status.status = name, GoalStatus.SUCCEEDED
            events.handle("move_base/result", result, began + 2.0)

    drive("before", 40.0, ends=True)
    drive("across", 50.0, ends=False)
    drive("after", 5.0, ends=True)
    told = events.drive()
    assert [(goal.pose.x, goal.started) for goal in told.goals] == [(50.0, 5.0), (5.0, 5.0)]
    assert [stamp for stamp, _ in told.plans] == [5.0, 6.0] and len(told.seen) == 2
    assert told.span == (5.0, 7.0) and told.commands[:, 0].tolist() == told.estimate[:, 0].tolist() == [5.0, 6.0]


def test_the_command_leaves_a_report_beside_the_bag(tmp_path, capsys):
    write_bag(str(tmp_path / "drive.bag"))
    drive_report.main([str(tmp_path / "drive.bag")])
    assert {"report.json", "report.png", "report.html"} <= {file.name for file in tmp_path.iterdir()}
    assert "report.png" in capsys.readouterr().out


@pytest.mark.parametrize(
    "kind, words", [("missing", "cannot be read"), ("empty", "shows no drive"), ("text", "cannot be read")]
)
def test_a_file_that_shows_no_drive_is_named_with_the_reason(tmp_path, kind, words):
    path = tmp_path / "odd.bag"
    if kind == "empty":
        rosbag.Bag(str(path), "w").close()
    elif kind == "text":
        path.write_text("not a bag")
    with pytest.raises(SystemExit, match=words) as ended:
        drive_report.main([str(path)])
    assert "odd.bag" in str(ended.value)


def test_of_a_bag_whose_recorder_was_killed_is_told_what_mends_it(tmp_path):
    """Of a drive that a CI ended by force, all that was said was that the bag is unindexed."""
    write_bag(str(tmp_path / "drive.bag"))
    killed = tmp_path / "killed.bag"
    with rosbag.Bag(str(tmp_path / "drive.bag")) as bag:
        index = bag._index_data_pos
    data = bytearray((tmp_path / "drive.bag").read_bytes()[:index])
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at:at + 8] = bytes(8)  # as a recorder has it until it closes its bag
    killed.write_bytes(data)
    with pytest.raises(SystemExit) as ended:
        drive_report.main([str(killed)])
    assert f"`rosbag reindex {killed}` mends it" in str(ended.value)


def test_identity_is_what_it_says():
    assert conversions.transform_from_message(conversions.transform_to_message(IDENTITY)) == IDENTITY


def test_a_report_outlives_a_truth_that_is_no_number(tmp_path):
    path = str(tmp_path / "drive.bag")
    write_bag(path, nan_truths=(10, 50))
    drive, _topics = read_bag(path)
    assert len(drive.truth) == 49 and np.isfinite(drive.truth).all()
    assert drive.summary()["localization_error_max"] == pytest.approx(0.0, abs=1e-6)
