"""What the tests of the whole stack share: clients as processes, the simulator's truth, the nodes' logs."""

import os
import subprocess
import sys
from typing import List, NamedTuple

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

import numpy as np  # noqa: E402
import rospy  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from programs import program  # noqa: E402
from ros_testing import Listener, wait_until  # noqa: E402
from rosgraph_msgs.msg import Log  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.common.conversions import pose_from_message  # noqa: E402
from mbf_relay.ros.common.rospy_patches import receiving  # noqa: E402

OF_THE_MACHINE = (
    "the machine is too slow for it", "the robot drives slower until that is less",
    "no velocity command answered the last scan", "what it saw is too old to drive by", "control cycles came to a stop",
    "Inbound TCP/IP connection failed",
)
"""What simulator and server say where the machine cannot keep up, and rospy of a client that ended as it connected."""


class Run(NamedTuple):
    """How a client ended: exit status and what it printed."""

    status: int
    output: str


def run_client(name: str, *arguments: str, timeout: float = 240.0) -> Run:
    """Run one of the package's executables as a user does and return how it ended."""
    process = subprocess.Popen(
        [program(name), *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    try:
        output = process.communicate(timeout=timeout)[0]
    except subprocess.TimeoutExpired:
        process.terminate()
        raise AssertionError(
            f"waited {timeout:.0f} s for {name} to end, in vain:\n{process.communicate()[0]}"
        ) from None
    return Run(process.returncode, output)


class Witness:
    """Sees where the robot is, what it touches, and what the nodes complain of."""

    def __init__(self) -> None:
        self._truth = Listener("ground_truth", Odometry, connected=True)
        self._contacts = Listener("contacts", MarkerArray)
        self._log = Listener("/rosout", Log, connected=True)

    @property
    def pose(self) -> Pose2D:
        """Where the robot really is, in the map frame."""
        wait_until(lambda: self._truth.last, "the simulator's truth")
        return pose_from_message(self._truth.last.pose.pose)

    @property
    def way(self) -> List[Pose2D]:
        """Every pose so far."""
        return [pose_from_message(message.pose.pose) for message in list(self._truth.messages)]

    def forget(self) -> None:
        """Start the way anew."""
        self._truth.messages.clear()

    def forget_all(self) -> None:
        """Keep of each message only the newest, where a test goes on for hours."""
        for listener in (self._truth, self._contacts, self._log):
            del listener.messages[:-1]

    @property
    def trajectory(self) -> np.ndarray:
        """The way with its times: rows of time (s), x, y (m), heading (rad)."""
        messages = list(self._truth.messages)
        return np.array([(m.header.stamp.to_sec(), *pose_from_message(m.pose.pose)) for m in messages]).reshape(-1, 4)

    def way_to(self, x: float, y: float) -> float:
        """Return how near (m) the robot has come to a point."""
        return min(((pose.x - x) ** 2 + (pose.y - y) ** 2) ** 0.5 for pose in self.way)

    def touched(self) -> List[str]:
        """Return what the robot has touched."""
        markers = [marker for message in list(self._contacts.messages) for marker in message.markers]
        return [marker.ns for marker in markers if marker.action == marker.ADD]

    def warnings(self) -> List[str]:
        """Return every warning and error the nodes have logged, but for those that say how slow this machine is."""
        return [line for line in self.complaints() if not any(words in line for words in OF_THE_MACHINE)]

    def complaints(self) -> List[str]:
        """Return every warning and error the nodes have logged."""
        return [f"{message.name}: {message.msg}" for message in list(self._log.messages) if message.level >= Log.WARN]


def start_test_node(name: str) -> None:
    """Start this process's node and wait for the simulated clock."""
    receiving.apply_patches()
    rospy.init_node(name)
    wait_until(lambda: rospy.get_time() != 0.0, "/clock", 60.0)
