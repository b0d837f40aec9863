"""A client with bare topics that has a robot set out for places of the circle, and takes the time of the answers."""

from __future__ import annotations

import gc
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
from ros_testing import wait_until

from mbf_relay.simulation.arena import CIRCLE

PATIENCE = 60.0
"""Wall time (s) after which an answer counts as lost, the graph's start included."""
PAUSE = 0.1
"""Longest wall time (s) between a goal and the next, so that goals come at any moment of the costmaps' and the clock's.
"""
SEED = 1
VELOCITY, ZERO = "goal to first velocity", "cancel to zero velocity"
MOVES, STANDS = "a velocity", "a zero velocity"


class CircleClient:
    """Sends goals and notes when what it waits for arrives.

    Args:
        name: Of its node.
        action: Name of the action that drives.
        goal: Class of that action's goals, with a `target_pose`.
        result: Class of its results.
    """

    def __init__(self, name: str, action: str, goal: Any, result: Any) -> None:
        import rospy
        from actionlib_msgs.msg import GoalID
        from geometry_msgs.msg import Twist

        rospy.init_node(name, anonymous=True, disable_signals=True)
        self.name = rospy.get_name()
        self._rospy, self._goal_id, self._drive_goal = rospy, GoalID, goal
        self.rng = np.random.default_rng(SEED)
        self._arrived = threading.Condition()
        self._arrivals: Dict[str, Tuple[float, Any]] = {}  # the first of each kind since it was last asked for
        self._number = 0
        self._links: List[Any] = []
        self.drives, self.cancels = self.publish(f"{action}/goal", goal), self.publish(f"{action}/cancel", GoalID)
        self.listen("cmd_vel", Twist, self._take_velocity)
        self.listen(f"{action}/result", result, self.take_result)

    def publish(self, topic: str, kind: Any) -> Any:
        """Return a publisher whose connection `wait_for_links` waits for."""
        self._links.append(self._rospy.Publisher(topic, kind, queue_size=50, tcp_nodelay=True))
        return self._links[-1]

    def listen(self, topic: str, kind: Any, take: Callable[[Any], None]) -> None:
        """Have the messages of a topic taken, by a connection that `wait_for_links` waits for."""
        self._links.append(self._rospy.Subscriber(topic, kind, take, tcp_nodelay=True))

    def wait_for_links(self) -> None:
        """Return once every topic has its other end."""
        wait_until(lambda: all(link.get_num_connections() for link in self._links), "the graph's topics", PATIENCE)

    def put_garbage_away(self) -> None:
        """Keep this process' own garbage out of what is timed from now on."""
        gc.collect()
        gc.freeze()

    def touch_and_go(self, goals: int) -> Dict[str, List[float]]:
        """Have the robot set out for goals of the circle, each cancelled once it moves.

        Returns:
            The times (ms) from goals to velocities and from cancels to zeros.
        """
        taken: Dict[str, List[float]] = {VELOCITY: [], ZERO: []}
        for _ in range(goals):
            goal = self.new_goal()
            taken[VELOCITY].append(self.ask(self.drives, goal, MOVES)[0])
            taken[ZERO].append(self.ask(self.cancels, goal.goal_id, STANDS)[0])
            if self.wait(goal.goal_id.id) is None:
                raise RuntimeError(f"waited {PATIENCE:g} s for the goal's end, in vain")
            self.pause()
        return taken

    def new_goal(self, place: Optional[int] = None, kind: Any = None) -> Any:
        """Return an action's goal.

        Args:
            place: Which of the circle's; drawn where it is None.
            kind: Class of the goal, that of the action that drives where it is None.
        """
        self._number += 1
        goal = (kind or self._drive_goal)(goal_id=self._goal_id(id=f"goal-{self._number}"))
        pose = goal.goal.target_pose
        pose.header.frame_id = "map"
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.z, pose.pose.orientation.w = CIRCLE[
            self.rng.integers(len(CIRCLE)) if place is None else place]
        return goal

    def ask(self, publisher: Any, message: Any, answer: str) -> Tuple[float, Any]:
        """Publish and wait for what answers it; return the time (ms) between, and the answer."""
        with self._arrived:
            self._arrivals.pop(answer, None)
        sent = time.monotonic()
        publisher.publish(message)
        found = self.wait(answer)
        if found is None:
            raise RuntimeError(f"no answer '{answer}' within {PATIENCE:g} s to:\n{message}")
        return 1e3 * (found[0] - sent), found[1]

    def wait(self, answer: str, patience: float = PATIENCE) -> Optional[Tuple[float, Any]]:
        """Return when an answer arrived and what it says, and forget it; None where it does not come."""
        with self._arrived:
            self._arrived.wait_for(lambda: answer in self._arrivals, max(0.0, patience))
            return self._arrivals.pop(answer, None)

    def pause(self) -> None:
        """Let the next goal come at another moment of every cycle."""
        time.sleep(self.rng.uniform(0.0, PAUSE))

    def take_result(self, message: Any) -> None:
        """Note the result of an action's goal."""
        self._note(message.status.goal_id.id, message)

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _take_velocity(self, twist: Any) -> None:
        self._note(MOVES if twist.linear.x or twist.linear.y or twist.angular.z else STANDS, twist)

    def _note(self, answer: str, message: Any) -> None:
        now = time.monotonic()
        with self._arrived:
            self._arrivals.setdefault(answer, (now, message))
            self._arrived.notify_all()
