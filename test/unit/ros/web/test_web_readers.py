"""Messages on their way to a browser: judged once, and what means nothing is left out or refused."""

import io
import math
from types import SimpleNamespace

import numpy as np
import pytest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Point32, Polygon, PolygonStamped, Pose, PoseArray, PoseStamped, Quaternion, Vector3
from mbf_msgs.msg import MoveBaseActionResult as FlexActionResult
from move_base_msgs.msg import MoveBaseActionResult
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.unread import unread
from mbf_relay.ros.web import readers, robot_view
from mbf_relay.ros.web.inbox import WAITING, Inbox
from mbf_relay.ros.web.sources import SOURCES, robots_of, topics_of

NAN = float("nan")


def grid(width=4, height=3, resolution=0.05):
    message = OccupancyGrid()
    message.header.frame_id = "/map"
    message.info.width, message.info.height, message.info.resolution = width, height, resolution
    message.info.origin.orientation.w = 1.0
    return message


def cloud(rows, names=("x", "y", "z", "theta", "cost")):
    data = np.array(rows, dtype=np.float32).reshape(-1, len(names))
    fields = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate(names)]
    return PointCloud2(
        height=1, width=len(data), fields=fields, point_step=4 * len(names), row_step=data.nbytes, data=data.tobytes())


def test_a_grid_lies_where_its_message_says():
    shape = readers.grid_shape(grid())
    assert (shape.width, shape.height, shape.resolution, shape.frame) == (4, 3, 0.05, "map")


@pytest.mark.parametrize("resolution", [0.0, -0.05, NAN, math.inf])
def test_a_grid_whose_cells_have_no_size_is_refused(resolution):
    with pytest.raises(InvalidMessage):
        readers.grid_shape(grid(resolution=resolution))


def test_a_grid_no_page_could_hold_is_refused():
    with pytest.raises(InvalidMessage):
        readers.grid_shape(grid(width=100000, height=100000))


def test_a_scan_shows_what_was_hit_and_no_more():
    scan = LaserScan(
        angle_min=0.0,
        angle_increment=math.pi / 2.0,
        range_min=0.1,
        range_max=3.5,
        ranges=[1.0, 2.0, math.inf, NAN, 0.0, 3.5],
    )
    np.testing.assert_allclose(readers.scan_points(scan), [(1.0, 0.0), (0.0, 2.0)], atol=1e-9)


def test_particles_come_with_their_headings():
    poses = [
        Pose(Point(1.0, 2.0, 0.0), Quaternion(0.0, 0.0, math.sin(a / 2.0), math.cos(a / 2.0))) for a in (0.5, -3.0)
    ]
    np.testing.assert_allclose(readers.particle_poses(PoseArray(poses=poses)), [(1.0, 2.0, 0.5), (1.0, 2.0, -3.0)])
    assert readers.particle_poses(PoseArray()).shape == (0, 3)


def test_a_plan_with_a_pose_that_is_no_number_is_shown_without_it():
    poses = [PoseStamped(pose=Pose(position=Point(x, 0.0, 0.0))) for x in (0.0, NAN, 1.0)]
    np.testing.assert_allclose(readers.path_points(Path(poses=poses)), [(0.0, 0.0), (1.0, 0.0)])
    assert readers.path_points(Path()).shape == (0, 2)


def test_a_footprint_is_its_corners():
    polygon = PolygonStamped(polygon=Polygon([Point32(0.1, 0.1, 0.0), Point32(NAN, 0.0, 0.0), Point32(-0.1, 0.1, 0.0)]))
    assert readers.polygon_points(polygon).shape == (2, 2)


def test_trajectories_are_told_from_cheap_to_dear():
    points = readers.cloud_points(
        cloud([(1.0, 2.0, 0.0, 0.0, 10.0), (1.0, 3.0, 0.0, 0.0, 30.0), (2.0, 3.0, 0.0, 0.0, 20.0)])
    )
    np.testing.assert_allclose(points, [(1.0, 2.0, 0.0), (1.0, 3.0, 1.0), (2.0, 3.0, 0.5)])
    assert readers.cloud_points(cloud([])).shape == (0, 3)


def test_a_cloud_whose_size_does_not_fit_or_that_has_no_cost_is_refused():
    short = cloud([(1.0, 2.0, 0.0, 0.0, 1.0)])
    short.data = short.data[:-4]
    for wrong in (short, cloud([(1.0, 2.0)], ("x", "y"))):
        with pytest.raises(InvalidMessage):
            readers.cloud_points(wrong)


def test_boxes_have_outlines_and_what_stands_elsewhere_or_nowhere_has_none():
    box = Marker(
        type=Marker.CUBE, pose=Pose(Point(1.0, 2.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)), scale=Vector3(0.4, 0.2, 1.0)
    )
    pillar = Marker(type=Marker.CYLINDER, pose=box.pose, scale=Vector3(0.2, 0.2, 1.0))
    nowhere = Marker(
        type=Marker.CUBE, pose=Pose(Point(NAN, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)), scale=Vector3(1.0, 1.0, 1.0)
    )
    elsewhere = Marker(type=Marker.CUBE, pose=box.pose, scale=box.scale)
    for marker, frame in ((box, "map"), (pillar, "/map"), (nowhere, "map"), (elsewhere, "moon")):
        marker.header.frame_id = frame
    outlines = readers.obstacle_outlines(MarkerArray([box, pillar, nowhere, elsewhere]), "map")
    assert len(outlines) == 2
    assert sorted(map(tuple, outlines[0])) == [(0.8, 1.9), (0.8, 2.1), (1.2, 1.9), (1.2, 2.1)]


def test_only_warnings_of_the_log_are_told_and_long_ones_shortened():
    assert readers.log_entry(Log(level=Log.INFO, name="/a", msg="fine")) is None
    entry = readers.log_entry(Log(level=Log.ERROR, name="/a", msg="x\ny" * 1000))
    assert (entry["level"], len(entry["text"])) == ("error", 300)


def test_unread_bytes_become_the_message_they_were():
    import io

    message = Odometry(child_frame_id="base")
    message.twist.twist.linear.x = 0.5
    buffer = io.BytesIO()
    message.serialize(buffer)
    assert unread(Odometry)().deserialize(buffer.getvalue()).read() == message


def test_the_inbox_keeps_the_newest_or_every_one_in_the_order_they_came():
    inbox = Inbox({})
    for number in range(3):
        inbox.put("scan", number, False)
        inbox.put("update", number, True)
    assert inbox.take(0.0) == [("update", 0), ("update", 1), ("scan", 2), ("update", 2)]
    assert inbox.take(0.0) == []


def test_the_inbox_of_a_thread_that_hangs_does_not_grow_for_ever():
    inbox = Inbox({})
    for number in range(3 * WAITING):
        inbox.put("update", number, True)
    assert len(inbox.take(0.0)) == WAITING


def test_what_comes_oftener_than_it_is_looked_at_waits():
    inbox = Inbox({"odometry": 0.1})
    seen = []
    for tick in range(100):
        inbox.put("odometry", tick, False)
        seen += inbox.take(0.02 * tick)
    assert 18 <= len(seen) <= 21


def test_the_first_pattern_with_a_publisher_is_listened_to():
    plan = SOURCES["global_plan"]
    both = {"/r/move_base_flex/NavfnROS/plan": "nav_msgs/Path", "/r/move_base/NavfnROS/plan": "nav_msgs/Path",
            "/move_base_flex/NavfnROS/plan": "nav_msgs/Path", "/r/move_base_flex/X/plan": "std_msgs/String"}
    assert topics_of(plan, "/r/", both) == ["/r/move_base_flex/NavfnROS/plan"]
    both.pop("/r/move_base_flex/NavfnROS/plan")
    assert topics_of(plan, "/r/", both) == ["/r/move_base/NavfnROS/plan"]
    assert topics_of(plan, "/other/", both) == []
    assert topics_of(SOURCES["map"], "/r/", {"/map": "nav_msgs/OccupancyGrid"}) == ["/map"]


def test_robots_are_found_by_their_namespaces():
    topics = [
        "/scan",
        "/burger1/odom",
        "/fleet/burger2/move_base/status",
        "/move_base_flex/move_base/status",
        "/scanner",
        "/b/scan_raw",
    ]
    assert robots_of(topics) == ["/", "/burger1/", "/fleet/burger2/"]


def viewed(inbox):
    """Return a robot's view of which no frame is known."""
    return robot_view.RobotView(SimpleNamespace(
        inbox=inbox, namespace="/", base_frame="base", lookup=lambda *_args, **_options: None), "map")


def received(message):
    """Return a message as it comes in."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return unread(type(message))().deserialize(buffer.getvalue())


def test_a_goal_that_was_sent_before_anybody_looked_is_shown_where_its_plan_ends():
    path = Path(poses=[PoseStamped(), PoseStamped()])
    path.header.frame_id = "map"
    for stamped, x in zip(path.poses, (0.0, 2.0)):
        stamped.pose.position.x, stamped.pose.orientation.z = x, 1.0
    inbox = Inbox({})
    view = viewed(inbox)
    inbox.put("status", received(GoalStatusArray(status_list=[GoalStatus(status=GoalStatus.ACTIVE)])), every=True)
    inbox.put("global_plan", received(path), every=True)
    view.update(1.0)
    assert view.words(1.0)["goal"]["goal"] == [2.0, 0.0, 3.142]


@pytest.mark.parametrize("first, second", [("outcome", "result"), ("result", "outcome")])
def test_a_person_reads_why_a_goal_failed_whichever_topic_tells_its_end_first(first, second):
    status = GoalStatus(goal_id=GoalID(id="mine"), status=GoalStatus.ABORTED, text="Failed to find a valid plan.")
    messages = {"outcome": FlexActionResult(status=status), "result": MoveBaseActionResult(status=status)}
    messages["outcome"].result.message = "no free cells connect start and goal"
    inbox = Inbox({})
    view = viewed(inbox)
    for key in (first, second):
        inbox.put(key, received(messages[key]), every=True)
        view.update(1.0)
    assert view.story.outcome == "Failed to find a valid plan. (no free cells connect start and goal)"
    assert view.ended == [("mine", "failed")], "one end"


def test_a_goal_that_was_cancelled_is_not_shown_as_driven_for_by_older_news():
    """Result and status come by two ways: the page told of a robot that drives until the next goal ended."""
    inbox, cancelled = Inbox({}), GoalID(id="mine")
    view = viewed(inbox)
    ended = MoveBaseActionResult(status=GoalStatus(goal_id=cancelled, status=GoalStatus.PREEMPTED))
    older = GoalStatusArray(status_list=[GoalStatus(goal_id=cancelled, status=GoalStatus.PREEMPTING)])
    next_one = GoalStatusArray(status_list=[GoalStatus(goal_id=GoalID(id="next"), status=GoalStatus.ACTIVE)])
    for key, message, state in (
            ("status", older, "active"), ("result", ended, "cancelled"), ("status", older, "cancelled"),
            ("status", next_one, "active")):
        inbox.put(key, received(message), every=True)
        view.update(1.0)
        assert view.story.state == state


def test_a_message_that_cannot_be_read_takes_no_other_from_the_page(monkeypatch):
    told = []
    monkeypatch.setattr(robot_view.rospy, "logwarn_throttle", lambda _period, text: told.append(text))
    inbox = Inbox({})
    view = viewed(inbox)
    shown = grid()
    shown.data = [0] * 12
    inbox.put("scan", unread(LaserScan)().deserialize(b"torn"), every=False)
    inbox.put("map", received(shown), every=False)
    view.update(1.0)
    assert view.has_map and len(told) == 1 and told[0].startswith("scan of / is not shown")


def test_a_node_that_has_died_is_not_shown_as_well_for_ever():
    """The page said "all well", and how well the scan fits, of a localization that had ended."""
    inbox, shown = Inbox({}), []
    view = viewed(inbox)
    share = KeyValue("share of the scan on the map's walls [%]", "93")
    died = DiagnosticStatus(name="amcl: scans", message="scans are used", values=[share])
    alive = DiagnosticStatus(name="simulator: simulation", message="running")
    view.layers["diagnostics"].show = lambda header: shown.append(header["entries"])
    for now, reported in ((1.0, [died, alive]), (7.0, [alive])):
        inbox.put("diagnostics", received(DiagnosticArray(status=reported)), every=True)
        view.update(now)
        assert view.words(now)["fit"] == ("93" if died in reported else None)
    assert [(entry["name"], entry["level"]) for entry in shown[0]] == [(died.name, 0), (alive.name, 0)]
    assert [(entry["name"], entry["level"]) for entry in shown[-1]] == [(died.name, 3), (alive.name, 0)]
    assert "no report" in shown[-1][0]["text"] and "scans are used" in shown[-1][0]["text"]
