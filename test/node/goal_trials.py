"""Trials of goals on a graph of relay, server and a robot of paper.

Cancelled, replaced by nonsense, orphaned, in crowds.

The rostest makes a few of each, `scripts/benchmark reliability` as many as a figure needs. Nothing here judges; each
trial returns what a robot and its client would have noticed.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any, Dict, List, NamedTuple, Optional

import rospy
from actionlib import ActionClient as StockClient
from actionlib import CommState
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from mbf_msgs import msg as mbf
from move_base_msgs import msg as move_base_msgs
from nav_msgs.msg import Odometry
from programs import program
from ros_testing import Listener, wait_until

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "paper_server.py")
RELAY = [program("move_base_relay"), "__name:=move_base"]
TERMINAL = (2, 3, 4, 5, 8)
NAN, INF = float("nan"), float("inf")
STANDS_FOR = 0.25
"""Wall time (s) without a velocity after which a robot counts as standing."""
LATEST_END = 30.0
"""Wall time (s) without any goal's end after which those that are left count as never ended."""
FACES = {
    "relay": ("move_base", move_base_msgs.MoveBaseAction),
    "move_base": ("move_base_flex/move_base", mbf.MoveBaseAction),
    "exe_path": ("move_base_flex/exe_path", mbf.ExePathAction),
    "recovery": ("move_base_flex/recovery", mbf.RecoveryAction),
    "get_path": ("move_base_flex/get_path", mbf.GetPathAction),
}
"""Where goals can be sent: the action's name and type."""
BROKEN = {
    "x is NaN": {"x": NAN},
    "y is infinite": {"y": INF},
    "x is -infinite": {"x": -INF},
    "x is 1e300": {"x": 1e300},
    "quaternion NaN": {"quaternion": (0.0, 0.0, NAN, 1.0)},
    "quaternion infinite": {"quaternion": (0.0, 0.0, 0.0, INF)},
    "quaternion 1e200": {"quaternion": (1e200, 0.0, 0.0, 1e200)},
    "quaternion zero": {"quaternion": (0.0, 0.0, 0.0, 0.0)},
    "upside down": {"quaternion": (1.0, 0.0, 0.0, 0.0)},
    "unknown frame": {"frame": "atlantis"},
    "no frame": {"frame": ""},
}
"""Goals that cannot be carried out."""


class Trial(NamedTuple):
    """What came of one trial.

    Attributes:
        states: The goal's terminal states, of which there should be one.
        text: The status text and the reason beside it.
        stopped_after: Wall time (s) from what should have stopped the robot to its last velocity but zero; 0 where
            there was none, infinite where it never stood.
        went_on: Whether the status told of the goal in another state after its result.
        zero_after: Wall time (s) from what should have stopped a robot that drove to the first zero, None where none
            drove or no zero came.
    """

    states: List[int]
    text: str
    stopped_after: float
    went_on: bool
    zero_after: Optional[float] = None


def pose(x: float = 0.0, y: float = 0.0, frame: str = "map", quaternion: Any = (0.0, 0.0, 0.0, 1.0)) -> PoseStamped:
    """Return a pose."""
    stamped = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(*quaternion)))
    stamped.header.frame_id = frame
    return stamped


class Face:
    """One action, with its bare topics."""

    def __init__(self, name: str, action_type: Any) -> None:
        action = action_type()
        self.goal_type, self.results, self.states = type(action.action_goal), {}, {}
        self.goals = rospy.Publisher(f"{name}/goal", self.goal_type, queue_size=100, tcp_nodelay=True)
        self.cancels = rospy.Publisher(f"{name}/cancel", GoalID, queue_size=100, tcp_nodelay=True)
        self._result = rospy.Subscriber(
            f"{name}/result", type(action.action_result), self._take_result, tcp_nodelay=True
        )
        rospy.Subscriber(f"{name}/status", GoalStatusArray, self._take_status, tcp_nodelay=True)

    @property
    def is_connected(self) -> bool:
        """Whether a server is there."""
        return all(link.get_num_connections() for link in (self.goals, self.cancels, self._result))

    def went_on(self, name: str) -> bool:
        """Return whether a goal was in another state after a terminal one."""
        states = self.states.get(name, [])
        return any(before in TERMINAL and after != before for before, after in zip(states, states[1:]))

    def _take_result(self, message: Any) -> None:
        self.results.setdefault(message.status.goal_id.id, []).append(message)

    def _take_status(self, message: GoalStatusArray) -> None:
        for status in message.status_list:
            states = self.states.setdefault(status.goal_id.id, [])
            if states[-1:] != [status.status]:
                states.append(status.status)


class GoalTrials:
    """The graph and its trials; every trial leaves the robot standing, and `start` starts again what one has ended.

    Args:
        silence: Wall time (s) of silence after which the relay takes a server that is connected for hung.
    """

    def __init__(self, silence: float = 0.7) -> None:
        rospy.set_param("move_base_flex", {"tf_timeout": 0.3, "recovery_enabled": False,
                                           "script": {"plan_time": 0.03, "recovery_steps": 40}})
        rospy.set_param("move_base", {"server_timeout": 30.0, "silence_timeout": silence})
        self._moves: List[float] = []
        self._zeros: List[float] = []
        rospy.Subscriber("cmd_vel", Twist, self._take_velocity, queue_size=1000, tcp_nodelay=True)
        self.odometry = Listener("odom", Odometry)
        self.faces = {name: Face(*face) for name, face in FACES.items()}
        self._number = 0
        self.server = self.relay = None
        self.start()

    def start(self) -> None:
        """Start what does not run."""
        if self.server is None:
            self.odometry.messages.clear()  # a new robot of paper, at the start
            self.server = subprocess.Popen([sys.executable, SERVER])
        if self.relay is None:
            self.relay = subprocess.Popen(RELAY)
        wait_until(lambda: all(face.is_connected for face in self.faces.values()), "relay and server", 60.0)
        wait_until(
            lambda: self.end_of(*self.send("relay", self.here())) == GoalStatus.SUCCEEDED,
            "a goal that is reached",
            60.0,
        )

    def close(self) -> None:
        """End what was started."""
        for process in (self.relay, self.server):
            if process is not None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in (self.relay, self.server):
            if process is not None:
                try:
                    process.wait(20.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    # trials

    def cancel(self, face: str, delay: float) -> Trial:
        """Cancel a goal that takes seconds, so long (s) after it was sent."""
        self._moves.clear()
        self._zeros.clear()
        _, name = self.send(face, self.ahead())
        threading.Event().wait(delay)
        at = time.monotonic()
        self.faces[face].cancels.publish(GoalID(id=name))
        return self._trial(face, name, at)

    def replace(self, kind: str) -> Trial:
        """Replace a drive by a goal of one of the BROKEN kinds, then cancel everything."""
        self.drive()
        _, name = self.send("relay", pose(**{"x": 1.0, **BROKEN[kind]}))
        self.end_of("relay", name)
        at = time.monotonic()
        # all until now: it comes by a connection of its own, maybe after the next trial's goal
        self.faces["relay"].cancels.publish(GoalID(stamp=rospy.get_rostime()))
        return self._trial("relay", name, at)

    def orphan(self, how: signal.Signals) -> Trial:
        """Kill or stop the relay under a drive."""
        name = self.drive()
        at = time.monotonic()
        self.relay.send_signal(how)
        trial = self._trial("relay", name, at, ends=False)
        if how == signal.SIGSTOP:
            self.relay.send_signal(signal.SIGCONT)
            self.end_of("relay", name)
            trial = self._trial("relay", name, at, trial.stopped_after)
        else:
            self.relay.wait()
            self.relay = None
        return trial

    def lose_server(self, how: signal.Signals) -> Trial:
        """Kill or stop the server under a drive; the robot's wheels are in its process, so commands are looked at."""
        name = self.drive()
        at = time.monotonic()
        self.server.send_signal(how)
        stopped_after = wait_until(lambda: self._zero_after(at), "a zero from the relay", 20.0)
        self.end_of("relay", name)
        trial = self._trial("relay", name, at, stopped_after)
        if how == signal.SIGSTOP:
            self.server.send_signal(signal.SIGCONT)
        else:
            self.server.wait()
            self.server = None
        return trial

    def crowd(self, clients: int, rate: float, seconds: float) -> Dict[str, int]:
        """Have stock clients send, replace and cancel goals at once; return how many ended in which state.

        Args:
            clients: Number of actionlib.ActionClients, each in a thread of its own.
            rate: Goals a second that each sends.
            seconds: For how long (s).
        """
        # of its default of ten, a busy client drops some itself
        rospy.set_param("actionlib_client_pub_queue_size", 1000)
        made = [StockClient("move_base", move_base_msgs.MoveBaseAction) for _ in range(clients)]
        wait_until(lambda: all(c.pub_goal.get_num_connections() and c.result_sub.get_num_connections()
                               and c.status_sub.get_num_connections() for c in made), "connected clients", 60.0)
        handles: List[List[Any]] = [[] for _ in made]

        def work(number: int) -> None:
            pause, end = threading.Event(), time.monotonic() + seconds
            while time.monotonic() < end:
                handle = made[number].send_goal(move_base_msgs.MoveBaseGoal(self.ahead()))
                handles[number].append(handle)
                pause.wait(1.0 / rate)
                if len(handles[number]) % 3 == 0:
                    # not by the handle: actionlib's waits for the answer to a cancel also where the goal has ended
                    # before
                    goal_id = handle.comm_state_machine.action_goal.goal_id.id
                    made[number].pub_cancel.publish(GoalID(id=goal_id))

        threads = [threading.Thread(target=work, args=(number,)) for number in range(clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.faces["relay"].cancels.publish(GoalID())
        everyone = [handle for mine in handles for handle in mine]
        waiting, last_end = everyone, time.monotonic()
        while waiting and time.monotonic() - last_end < LATEST_END:
            threading.Event().wait(0.1)
            left = [handle for handle in waiting if handle.get_comm_state() != CommState.DONE]
            if len(left) < len(waiting):  # clients on a slow machine have much to read
                waiting, last_end = left, time.monotonic()
        counts: Dict[str, int] = {}
        for handle in everyone:
            ended = handle.get_comm_state() == CommState.DONE
            state = GoalStatus.to_string(handle.get_terminal_state()) if ended else "never ended"
            counts[state] = counts.get(state, 0) + 1
        for client in made:
            client.stop()
        self.stand()
        return counts

    # parts

    def here(self) -> PoseStamped:
        """Return where the robot is."""
        wait_until(lambda: self.odometry.last, "odometry")
        return pose(self.odometry.last.pose.pose.position.x)

    def ahead(self) -> PoseStamped:
        """Return a place that it takes seconds to reach."""
        return pose(self.here().pose.position.x + 5.0)

    def drive(self) -> str:
        """Send the relay a goal and return its id once the robot moves."""
        since = time.monotonic()
        _, name = self.send("relay", self.ahead())
        wait_until(lambda: self._moves and self._moves[-1] > since, "the robot to drive", 20.0)
        return name

    def send(self, face: str, target: PoseStamped) -> Any:
        """Send a goal; return face and id."""
        self._number += 1
        name = f"trial-{self._number}"
        goal = self.faces[face].goal_type(goal_id=GoalID(rospy.get_rostime(), name))
        if face == "exe_path":
            goal.goal.path.header.frame_id, x = "map", self.here().pose.position.x
            goal.goal.path.poses = [pose(x + 0.5 * step) for step in range(11)]
        elif face == "recovery":
            goal.goal.behavior = "R1"
        else:
            goal.goal.target_pose = target
        self.faces[face].goals.publish(goal)
        return face, name

    def end_of(self, face: str, name: str) -> int:
        """Wait for a goal's result and return its state."""
        results = self.faces[face].results
        return wait_until(lambda: results.get(name), f"the end of {name} at {face}", 30.0)[0].status.status

    def stand(self) -> None:
        """Wait until the robot stands."""
        wait_until(
            lambda: not self._moves or time.monotonic() - self._moves[-1] > STANDS_FOR, "the robot to stand", 20.0
        )

    def _trial(
        self, face: str, name: str, at: float, stopped_after: Optional[float] = None, ends: bool = True
    ) -> Trial:
        if ends:
            self.end_of(face, name)
        if stopped_after is None:
            try:
                self.stand()
                stopped_after = max(0.0, self._moves[-1] - at) if self._moves else 0.0
            except AssertionError:
                stopped_after = INF
        results = self.faces[face].results.get(name, [])
        text = "; ".join(f"{m.status.text} {getattr(m.result, 'message', '')}".strip() for m in results)
        zero_after = self._zero_after(at) if self._moves else None
        states = [m.status.status for m in results]
        return Trial(states, text, stopped_after, self.faces[face].went_on(name), zero_after)

    def _zero_after(self, at: float) -> Optional[float]:
        """Return the time (s) from a moment to the first zero after it."""
        return next((zero - at for zero in list(self._zeros) if zero > at), None)

    def _take_velocity(self, twist: Twist) -> None:
        if twist.linear.x or twist.linear.y or twist.angular.z:
            self._moves.append(time.monotonic())
        else:
            self._zeros.append(time.monotonic())
