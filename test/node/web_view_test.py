#!/usr/bin/env python3
"""web_view in front of a robot made of paper: who may do what, what is refused, what comes of a lost connection."""

import os
import re
import signal
import stat
import subprocess
import sys

import rosgraph
import rostest
import tornado.httpclient
from actionlib_msgs.msg import GoalID, GoalStatus
from map_msgs.msg import OccupancyGridUpdate
from move_base_msgs.msg import MoveBaseActionResult
from rosgraph_msgs.msg import Log

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from node.web_view_stack import ViewProcess, WebViewCase  # noqa: E402
from ros_testing import Listener, wait_until  # noqa: E402
from web_client import StalledClient, WebClient  # noqa: E402

from mbf_relay.ros.common.connected_nodes import connected_nodes  # noqa: E402
from mbf_relay.ros.tools.demo_graph import free_port  # noqa: E402
from mbf_relay.view.feed import WINDOW  # noqa: E402

MALFORMED = (
    "", "{", "[]", "nonsense", '{"do": "goal", "x": NaN, "y": 0, "theta": 0}', '{"do": "goal"}', '{"do": 7}',
    "[" * 4000,
)
MARKUP = "<img src=x onerror=alert(1)>"


class WebViewTest(WebViewCase):
    def test_nobody_connected_means_no_subscription(self):
        self.open.wait_for_subscriptions(lambda topics: not topics, "no subscription")
        client = self.connect(layers=["robot"])
        self.open.wait_for_subscriptions(lambda topics: "/tf" in topics, "web_view to listen to /tf")
        self.assertNotIn("/scan", self.open.subscriptions())
        client.send(do="show", layers={"scan": 5.0})
        self.open.wait_for_subscriptions(lambda topics: "/scan" in topics, "web_view to listen to /scan")
        client.close()
        self.open.wait_for_subscriptions(lambda topics: not topics, "the subscriptions to end")

    def test_a_page_loaded_anew_leaves_the_wheels_their_connection(self):
        def connections():
            return [link[0] for link in self.robot.velocity._subscriber.impl.get_stats_info()]

        client = self.driver()
        client.send(do="show", layers={"scan": 5.0})
        self.open.wait_for_subscriptions(lambda topics: "/scan" in topics, "web_view to listen to /scan")
        before = connections()
        client.close()
        self.open.wait_for_subscriptions(lambda topics: "/scan" not in topics, "web_view to know that the page is gone")
        self.driver()
        self.assertEqual(connections(), before)

    def test_a_wrong_token_gets_nothing(self):
        for token in ("", "wrong", "se", "steer "):
            client = self.connect(self.guarded, token=token)
            wait_until(lambda: client.closed, "the connection to be closed")
            self.assertEqual([message["say"] for message in client.said], ["goodbye"])
            self.assertIn("token", client.closed[1])
            self.assertEqual(client.newest, {})

    def test_who_says_nothing_of_a_token_gets_nothing(self):
        client = self.connect(self.guarded, greet=False)
        self.assertIn("hello", client.refusal(do="goal", x=1.0, y=1.0, theta=0.0))
        self.assertIn("hello", client.refusal(do="show", layers={"map": 1.0}))
        self.assertEqual(client.newest, {})

    def test_who_may_look_may_not_drive(self):
        client = self.connect(self.guarded, token="see")
        self.assertFalse(client.wait_for("welcome")["drive"])
        client.layer("robot", lambda robot: robot["pose"] is not None, "with a pose")
        goals, moved = len(self.robot.goals.messages), len(self.robot.velocity.messages)
        wishes = (
            dict(do="goal", x=1.0, y=1.0, theta=0.0),
            dict(do="cancel"),
            dict(do="stick", forward=1.0, left=0.0),
            dict(do="pose", x=0.0, y=0.0, theta=0.0, spread=0.5, turn_spread=0.3),
            dict(do="clear"),
            dict(do="record", on=True),
            dict(do="tour", waypoints=[[0.0, 0.0, 0.0]], loop=True, pause=0.0),
            dict(do="reset"),
            dict(do="remove_obstacles"),
            dict(do="obstacle", x=1.0, y=1.0, size=0.3),
            dict(do="release"),
        )
        for wish in wishes:
            self.assertIn("drive token", client.refusal(**wish))
        self.assertEqual((len(self.robot.goals.messages), len(self.robot.velocity.messages)), (goals, moved))
        self.assertTrue(self.connect(self.guarded, token="steer").wait_for("welcome")["drive"])

    def test_another_sites_page_is_turned_away(self):
        for origin in ("http://evil.example", f"http://localhost:{self.open.port + 1}", "null"):
            with self.assertRaises(tornado.httpclient.HTTPClientError) as refusal:
                WebClient(self.open.port, origin=origin)
            self.assertEqual(refusal.exception.code, 403)
        self.connect(origin=f"http://127.0.0.1:{self.open.port}").wait_for("welcome")

    def test_a_foreign_name_made_to_point_here_gets_no_page(self):
        self.assertEqual(self.open.get("/", Host="evil.example").code, 403)
        self.assertEqual(self.open.get("/").code, 200)

    def test_the_page_may_load_nothing_from_elsewhere_and_be_framed_by_nobody(self):
        policy = self.open.get("/").headers["Content-Security-Policy"]
        self.assertIn("default-src 'none'", policy)
        self.assertIn("frame-ancestors 'none'", policy)
        for path in ("/", "/main.js", "/style.css"):
            body = self.open.get(path).body.decode()
            self.assertIsNone(re.search(r"""(src|href)=["']?(https?:)?//|url\(\s*["']?https?:|from ["']https?:""", body), path)  # noqa: E501

    def test_no_file_but_the_pages_can_be_had(self):
        for path in ("/../node.py", "/..%2fnode.py", "/%2e%2e/node.py", "/node.py", "//etc/passwd"):
            self.assertIn(self.open.get(path).code, (403, 404), path)

    def test_malformed_messages_are_refused_and_the_node_lives(self):
        client = self.driver()
        for number, message in enumerate(MALFORMED):
            client.send_raw(message)
            client.wait_for("refused", number)
        client.send_raw(b"\xff\xfe\x00")
        client.wait_for("refused", len(MALFORMED))
        client.send(do="ping", time=1.0)
        client.wait_for("pong")

    def test_an_oversized_message_ends_its_connection_alone(self):
        other, client = self.driver(), self.connect()
        client.send_raw("x" * 200000)
        wait_until(lambda: client.closed, "the connection to be closed")
        other.send(do="ping", time=1.0)
        other.wait_for("pong")

    def test_a_flood_of_messages_ends_its_connection_alone(self):
        other, client = self.driver(), self.connect()
        for _ in range(2000):
            client.send(do="ping", time=1.0)
        wait_until(lambda: client.closed, "the connection to be closed")
        self.assertIn("messages a second", client.wait_for("goodbye")["why"])
        other.send(do="ping", time=1.0)
        other.wait_for("pong")

    def test_two_hundred_browsers_at_once_are_told_that_there_are_too_many(self):
        self.guarded.wait_for_subscriptions(lambda topics: not topics, "the other tests' browsers to be gone")
        crowd = [self.connect(self.guarded, token="see", layers=["robot"]) for _ in range(200)]
        wait_until(
            lambda: sum(client.closed is not None for client in crowd) == 195, "195 of 200 to be turned away", 60.0
        )
        reasons = [client.words("goodbye")[0]["why"] for client in crowd if client.closed]
        self.assertTrue(all("5 browsers" in reason for reason in reasons))
        for client in crowd:
            if client.closed is None:
                client.wait_for("welcome")

    def test_a_browser_that_stops_reading_is_sent_no_queue(self):
        watcher = self.driver()
        deaf = self.connect(reads=False)
        wait_until(lambda: deaf.count["robot"] >= 1, "the first batch")
        for step in range(30):
            self.robot.where = (0.5 * step, 0.0)
            watcher.layer("robot", lambda robot: robot["pose"] == [0.5 * step, 0.0, 0.0], f"at {0.5 * step} m")
        self.assertLessEqual(deaf.count["robot"], WINDOW)

    def test_a_machine_that_went_to_sleep_with_its_page_open_is_not_waited_for(self):
        """Nothing reads what the system has taken in for it, and no end of the connection comes."""
        self.open.wait_for_subscriptions(lambda topics: not topics, "the other tests' browsers to be gone")
        asleep = StalledClient(self.open.port)
        try:
            self.open.wait_for_subscriptions(bool, "web_view to listen for it")
            awake = self.connect(layers=["robot"])
            for step in range(5):
                self.robot.where = (0.5 * step, 1.0)
                awake.layer("robot", lambda robot: robot["pose"] == [0.5 * step, 1.0, 0.0], f"at {0.5 * step} m")
            awake.close()
            self.open.wait_for_subscriptions(lambda topics: not topics, "web_view to give it up", 60.0)
        finally:
            asleep.close()

    def test_a_change_of_one_cell_sends_one_tile(self):
        client = self.driver()
        client.layer("global_costmap", lambda grid: len(grid["tiles"]) == 4, "whole")
        update = OccupancyGridUpdate(x=70, y=3, width=1, height=1, data=[100])
        wait_until(lambda: self.robot.costmap_updates.get_num_connections(), "web_view to listen to updates")
        wait_until(lambda: self.robot.costmap_updates.publish(update) or client.cells("global_costmap").count(100) == 1,
                   "the cell", period=0.5)  # a whole grid that was on its way yet undoes the first
        self.assertEqual(client.layer("global_costmap")["tiles"], [1])

    def test_0_a_robot_without_a_map_that_knows_where_it_is_is_sent_goals_as_well(self):
        client = self.connect()
        client.layer("robot", lambda robot: robot["pose"] is not None, "with a pose")
        wait_until(lambda: client.send(do="goal", x=0.5, y=-0.5, theta=0.0) or any(  # refused till somebody is found
            goal.goal.target_pose.pose.position.y == -0.5 for goal in self.robot.goals.messages), "it", period=0.5)

    def test_a_goal_goes_out_and_its_outcome_comes_back(self):
        client = self.driver()
        client.send(do="goal", x=1.0, y=-2.0, theta=1.0)
        goal = self.robot.goals.wait_for(lambda g: abs(g.goal.target_pose.pose.position.y + 2.0) < 1e-9, "the goal")
        self.assertEqual(goal.goal.target_pose.header.frame_id, "map")
        self.robot.result.publish(MoveBaseActionResult(
            status=GoalStatus(goal_id=goal.goal_id, status=GoalStatus.ABORTED, text=f"no way {MARKUP}")))
        state = client.layer("state", lambda told: told["goal"]["state"] == "failed", "of a failed goal")
        self.assertEqual(state["goal"]["outcome"], f"no way {MARKUP}")

    def test_waypoints_are_driven_one_after_the_other_and_a_cancel_ends_them(self):
        client = self.driver()
        before = len(self.robot.goals.messages)
        client.send(do="tour", waypoints=[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]], loop=False, pause=0.0)
        for x in (1.0, 2.0):
            goal = self.robot.goals.wait_for(
                lambda g: g.goal.target_pose.pose.position.x == x, f"the waypoint at {x}", since=before
            )
            self.robot.result.publish(
                MoveBaseActionResult(
                    status=GoalStatus(goal_id=goal.goal_id, status=GoalStatus.SUCCEEDED, text="Goal reached.")
                )
            )
        self.robot.goals.wait_for(
            lambda g: g.goal.target_pose.pose.position.x == 3.0, "the waypoint at 3.0", since=before
        )
        cancels = len(self.robot.cancels.messages)
        client.send(do="cancel")
        self.robot.cancels.wait_for(lambda _: True, "the cancel", since=cancels)
        client.layer("state", lambda told: told["tour"] is None, "without a list")

    def test_a_pose_estimate_has_the_covariance_asked_for(self):
        client = self.driver()
        before = len(self.robot.estimates.messages)
        client.send(do="pose", x=3.0, y=4.0, theta=0.5, spread=0.5, turn_spread=0.1)
        estimate = self.robot.estimates.wait_for(lambda _: True, "the estimate", since=before)
        covariance = estimate.pose.covariance
        self.assertAlmostEqual(covariance[0], 0.25)
        self.assertAlmostEqual(covariance[7], 0.25)
        self.assertAlmostEqual(covariance[35], 0.01)

    def drive(self, client):
        """Push the stick until the robot is told to move, and return how many velocities there were before."""
        before = len(self.robot.velocity.messages)

        def pushed():
            client.send(do="stick", forward=1.0, left=0.0)
            return any(m.linear.x > 0.0 for m in self.robot.velocity.messages[before:])

        wait_until(pushed, "a velocity", period=0.05)
        return before

    def assert_stopped(self, before):
        """Wait until one zero follows the last velocity; one between two pushes is a machine's that was busy."""
        def told():
            return [message.linear.x for message in self.robot.velocity.messages[before:]]

        wait_until(
            lambda: [speed == 0.0 for speed in told()[-2:]] == [False, True],
            lambda: f"one zero after the last velocity, not {told()}")

    def test_a_lost_connection_stops_the_robot(self):
        client = self.driver()
        before = self.drive(client)
        client.vanish()
        self.assert_stopped(before)

    def test_a_hand_that_falls_silent_stops_the_robot_though_the_connection_stands(self):
        client = self.driver()
        before = self.drive(client)
        self.assert_stopped(before)
        self.assertIsNone(client.closed)

    def test_letting_go_stops_the_robot(self):
        client = self.driver()
        before = self.drive(client)
        wait_until(  # between pushes that follow each other too soon for a hand that falls silent
            lambda: client.send(do="stick", forward=1.0, left=0.0) or client.send(do="release")
            or any(m.linear.x == 0.0 for m in self.robot.velocity.messages[before:]), "a zero", period=0.05)

    def test_the_node_that_ends_stops_the_robot(self):
        node = ViewProcess("ending_view")
        client = self.connect(node)
        client.wait_for("welcome")
        wait_until(
            lambda: "/ending_view" in dict(rosgraph.Master("t").getSystemState()[0]).get("/cmd_vel", []),
            "its velocities",
        )
        before = self.drive(client)
        node.end()
        self.assert_stopped(before)

    def test_taking_the_stick_takes_the_robot_from_its_goal(self):
        client = self.driver()
        cancels = len(self.robot.cancels.messages)
        self.drive(client)
        self.robot.cancels.wait_for(lambda _: True, "a cancel", since=cancels)

    def test_a_robot_whose_stick_is_held_does_not_set_out_for_a_goal_sent_meanwhile(self):
        client = self.driver()
        before = len(self.robot.cancels.messages)
        self.drive(client)
        self.robot.cancels.wait_for(lambda _: True, "the cancel of the goal before", since=before)
        cancels = len(self.robot.cancels.messages)  # a goal of anybody's may come from here on

        def called_off():
            client.send(do="stick", forward=1.0, left=0.0)
            return len(self.robot.cancels.messages) > cancels

        wait_until(called_off, "a cancel", period=0.05)

    def test_a_robot_that_drives_for_a_client_of_the_server_itself_is_stopped_from_the_page(self):
        actions = ("move_base_flex/exe_path", "move_base/recovery")  # of a server beside a relay, of one in move_base
        client = self.driver()
        listeners = [Listener(f"{action}/cancel", GoalID) for action in actions]
        for listener in listeners:  # another test's node may be there a little longer
            wait_until(lambda: "/open_view" in connected_nodes(listener._subscriber), "this node's publisher")
        for listener in listeners:  # whom the node itself may not have seen yet, so that it is told again
            wait_until(
                lambda told=listener: client.send(do="cancel") or told.messages, f"a cancel on {listener.topic}",
                period=0.1)

    def test_two_hands_do_not_drive_at_once(self):
        one, two = self.driver(), self.connect()
        two.wait_for("welcome")
        self.drive(one)

        def refused():
            one.send(do="stick", forward=0.5, left=0.0)
            two.send(do="stick", forward=-1.0, left=0.0)
            return two.words("refused")

        self.assertIn("another browser", wait_until(refused, "a refusal", period=0.05)[0]["why"])

    def test_a_warning_of_the_log_is_told_and_kept_as_text(self):
        client = self.driver()
        wait_until(
            lambda: self.robot.log.get_num_connections() >= 1 and "/rosout_agg" in self.open.subscriptions(), "the log"
        )

        def told():
            self.robot.log.publish(Log(level=Log.WARN, name="/paper", msg=MARKUP))
            return client.newest.get("log", ({"entries": []},))[0]["entries"]

        self.assertEqual(wait_until(told, "the warning", period=0.2)[-1]["text"], MARKUP)

    def test_the_tokens_of_a_node_beyond_this_machine_are_its_owners_alone(self):
        node = ViewProcess("wide_view", address="0.0.0.0")
        try:
            wait_until(lambda: re.search(r"tokens are kept in (\S+)", node.output), "the tokens' place")
            path = re.search(r"tokens are kept in ([^\s\x1b]+)", node.output).group(1)
            self.assertEqual(stat.S_IMODE(os.stat(path).st_mode), 0o600)
            client = self.connect(node)
            wait_until(lambda: client.closed, "the connection to be closed")
            token = re.search(r"#token=(\S+)  \(to drive\)", node.output).group(1)
            self.assertTrue(self.connect(node, token=token).wait_for("welcome")["drive"])
        finally:
            node.end()

    def test_a_restarted_node_goes_on_where_it_was(self):
        self.robot.show_map()
        node = ViewProcess("restarted_view")
        try:
            self.connect(node).layer("map")
            node.end(signal.SIGKILL)
            node.start()
            self.connect(node).layer("map")
        finally:
            node.end()

    def test_a_master_that_began_anew_is_found_again(self):
        port = free_port()
        uri = f"http://localhost:{port}"
        command = ["rosmaster", "--core", "-p", str(port)]
        master = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        node = None

        def listens():
            try:
                return dict(rosgraph.Master("web_view_test", master_uri=uri).getSystemState()[1]).get("/tf")
            except OSError:
                return None

        try:
            node = ViewProcess("orphaned_view", master=uri)
            client = self.connect(node)
            wait_until(lambda: listens() == ["/orphaned_view"], "web_view to listen to /tf")
            master.kill()
            master.wait()
            client.layer("state", lambda told: not told["master"], "without a master")
            master = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            self.assertEqual(node.process.wait(60.0), 1, "it ends, for its launch file to start it again")
            node.start()
            self.connect(node).layer("state", lambda told: told["master"], "with a master")
            wait_until(lambda: listens() == ["/orphaned_view"], "web_view to listen to /tf again")
        finally:
            if node is not None:
                node.end()
            master.kill()
            master.wait()


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "web_view", WebViewTest)
