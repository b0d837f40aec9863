"""What stands round web_view in its tests: a robot made of paper, and the node as a process of its own."""

import os
import signal
import subprocess
import unittest

import rosgraph
import rospy
import tornado.httpclient
from actionlib_msgs.msg import GoalID, GoalStatusArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Twist
from map_msgs.msg import OccupancyGridUpdate
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from nav_msgs.msg import OccupancyGrid
from programs import program
from ros_testing import LOOK_PERIOD, Listener, wait_until
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
from web_client import WebClient

from mbf_relay.ros.tools.demo_graph import free_port


class PaperRobot:
    """A robot's topics, published by hand."""

    def __init__(self):
        latched = dict(queue_size=1, latch=True)
        self.map = rospy.Publisher("map", OccupancyGrid, **latched)
        self.costmap = rospy.Publisher("move_base/global_costmap/costmap", OccupancyGrid, **latched)
        self.costmap_updates = rospy.Publisher(
            "move_base/global_costmap/costmap_updates", OccupancyGridUpdate, queue_size=10
        )
        self.scan = rospy.Publisher("scan", LaserScan, queue_size=1)
        self.tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self.status = rospy.Publisher("move_base/status", GoalStatusArray, queue_size=10)
        self.result = rospy.Publisher("move_base/result", MoveBaseActionResult, queue_size=10)
        self.log = rospy.Publisher("/rosout_agg", Log, queue_size=10)
        self.velocity = Listener("cmd_vel", Twist)
        self.goals = Listener("move_base/goal", MoveBaseActionGoal)
        self.cancels = Listener("move_base/cancel", GoalID)
        self.estimates = Listener("initialpose", PoseWithCovarianceStamped)
        self.where = (1.0, 2.0)
        rospy.Timer(rospy.Duration(0.05), self.stand)

    def stand(self, _event):
        """Say where the robot is."""
        transform = TransformStamped(child_frame_id="base_footprint")
        transform.header.frame_id, transform.header.stamp = "map", rospy.Time.now()
        transform.transform.translation.x, transform.transform.translation.y = self.where
        transform.transform.rotation.w = 1.0
        self.tf.publish(TFMessage([transform]))
        self.status.publish(GoalStatusArray())

    def show_map(self, size=100):
        """Publish an empty map and costmap of `size` cells square."""
        for publisher in (self.map, self.costmap):
            grid = OccupancyGrid(data=[0] * size ** 2)
            grid.header.frame_id = "map"
            grid.info.width = grid.info.height = size
            grid.info.resolution, grid.info.origin.orientation.w = 0.05, 1.0
            publisher.publish(grid)


class ViewProcess:
    """web_view as a process of its own."""

    def __init__(self, name, master=None, **parameters):
        self.name, self.port = name, free_port()
        self.environment = dict(os.environ, **({"ROS_MASTER_URI": master} if master else {}))
        words = [f"_{key}:={value}" for key, value in {"port": self.port, **parameters}.items()]
        self.log = os.path.join(os.environ.get("ROS_TEST_RESULTS_DIR", "/tmp"), f"{name}.log")
        self.command = [program("web_view"), f"__name:={name}", *words]
        self.start()

    def start(self):
        """Start it and wait until it serves."""
        with open(self.log, "wb") as stream:
            self.process = subprocess.Popen(self.command, stdout=stream, stderr=subprocess.STDOUT, env=self.environment)
        wait_until(self.serves, f"{self.name} to serve; it logs to {self.log}", period=LOOK_PERIOD)

    def serves(self):
        """Return whether the page can be had."""
        assert self.process.poll() is None, self.output
        try:
            return self.get("/").code == 200
        except OSError:
            return False

    def get(self, path, **headers):
        """Return what a path gives."""
        client = tornado.httpclient.HTTPClient()
        try:
            return client.fetch(f"http://127.0.0.1:{self.port}{path}", headers=headers, raise_error=False)
        finally:
            client.close()

    @property
    def output(self):
        """What it has logged."""
        with open(self.log, encoding="utf-8") as stream:
            return stream.read()

    def subscriptions(self):
        """Return the topics the node listens to, as the master knows them."""
        return sorted(
            t for t, nodes in rosgraph.Master("web_view_test").getSystemState()[1] if f"/{self.name}" in nodes
        )

    def wait_for_subscriptions(self, condition, what, timeout=30.0):
        """Wait until the topics it listens to meet a condition."""
        wait_until(
            lambda: condition(self.subscriptions()), lambda: f"{what}; it listens to {self.subscriptions()}", timeout,
            LOOK_PERIOD)

    def end(self, number=signal.SIGINT):
        """End it."""
        if self.process.poll() is None:
            self.process.send_signal(number)
            self.process.wait(20.0)


class WebViewCase(unittest.TestCase):
    """A test of two nodes that show one robot, to anybody and to who has a token; its browsers end with it."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("web_view_test")
        cls.robot = PaperRobot()
        cls.open = ViewProcess("open_view")
        cls.guarded = ViewProcess("guarded_view", view_token="see", drive_token="steer", max_clients=5)
        cls.clients = []

    @classmethod
    def tearDownClass(cls):
        for node in (cls.open, cls.guarded):
            node.end()
        for node in (cls.open, cls.guarded):
            assert "Traceback" not in node.output, node.output

    def tearDown(self):
        for client in self.clients:
            client.close()
        self.clients.clear()

    def connect(self, node=None, **options):
        """Return a client of the open node, or of another, that ends with the test."""
        client = WebClient((node or self.open).port, **options)
        self.clients.append(client)
        return client

    def driver(self):
        """Return a client that may drive and sees map and robot."""
        self.robot.show_map()
        client = self.connect()
        client.layer("state", lambda state: state["has_map"] and state["move_base"], "with a map")
        wait_until(lambda: self.robot.velocity.publishers, "web_view to offer velocities")
        return client
