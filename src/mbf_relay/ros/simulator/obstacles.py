"""Obstacles as markers: what comes in is put into the simulation, what stands there goes out for RViz."""

from __future__ import annotations

from typing import Dict, Hashable, List, Tuple, cast

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.ros.common.checks import InvalidMessage, check_finite, check_frame_is
from mbf_relay.ros.common.conversions import header
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Shape, Sphere
from mbf_relay.simulation.simulation import Simulation

SMALLEST, LARGEST = 0.001, 1000.0
"""Metres an obstacle may measure each way; the lidar's grid of triangles grows with the world it covers."""
WORLD = 1000.0
"""Metres from the world's middle within which an obstacle may stand."""
MOST_OBSTACLES = 2000
"""Obstacles that stand at one time."""

Key = Tuple[str, int]


class Obstacles:
    """The obstacles of a simulation, by the markers' (ns, id). Every call comes from the simulation's thread."""

    def __init__(self, simulation: Simulation, frame: str) -> None:
        self._simulation, self._frame = simulation, frame
        self._ends: Dict[Hashable, float] = {}
        self._are_told = False
        self._publisher = rospy.Publisher("~obstacles", MarkerArray, queue_size=10, latch=True)
        self.publish()

    def take(self, message: MarkerArray) -> None:
        """Do what each marker says; one that makes no sense is named in a warning and changes nothing.

        What stands then is told by `tell`, once for all messages that came together.
        """
        for marker in message.markers:
            try:
                self._take(marker)
            except (InvalidMessage, ValueError) as error:
                rospy.logwarn("obstacle %s/%d refused: %s", marker.ns, marker.id, error)
        self._are_told = False

    def tell(self) -> None:
        """Publish the obstacles that stand where that is due."""
        if not self._are_told:
            self.publish()

    def expire(self) -> None:
        """Take away what has outlived its lifetime."""
        if not self._ends:
            return
        over = [key for key, end in self._ends.items() if end <= self._simulation.now]
        for key in over:
            self._remove(key)
        if over:
            self.publish()

    def shift(self, seconds: float) -> None:
        """Take note that the clock is set on by so much, or back."""
        self._ends = {key: end + seconds for key, end in self._ends.items()}

    def forget(self) -> None:
        """Take note that a reset took all obstacles away."""
        self._ends.clear()
        self.publish()

    def publish(self) -> None:
        """Publish the obstacles that stand, after a marker that clears what RViz showed before."""
        self._are_told = True
        now = rospy.Time.from_sec(self._simulation.now)
        markers = [Marker(header=header(self._frame, now), action=Marker.DELETEALL)]
        markers += [self._marker(key, body, now) for key, body in self._simulation.scene.obstacles.items()]
        self._publisher.publish(MarkerArray(markers))

    def _take(self, marker: Marker) -> None:
        key: Key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            for known in list(self._simulation.scene.obstacles):
                self._remove(known)
        elif marker.action == Marker.DELETE:
            self._remove(key)
        elif marker.action in (Marker.ADD, Marker.MODIFY):
            body = obstacle_from_marker(marker, self._frame)
            if key not in self._simulation.scene.obstacles and len(self._simulation.scene.obstacles) >= MOST_OBSTACLES:
                raise ValueError(f"{MOST_OBSTACLES} obstacles stand already, which is the most")
            if key not in self._simulation.scene.obstacles and self._simulation.scene.obstructs(
                body, self._simulation.true_pose
            ):
                raise ValueError("it would stand in the robot; set it down farther away")
            self._simulation.scene.set_obstacle(key, body)
            self._ends.pop(key, None)
            if marker.lifetime.to_sec() > 0.0:
                self._ends[key] = self._simulation.now + marker.lifetime.to_sec()
        else:
            raise InvalidMessage(f"action {marker.action} is not known; it must be ADD, DELETE or DELETEALL")

    def _remove(self, key: Hashable) -> None:
        self._simulation.scene.remove_obstacle(key)
        self._ends.pop(key, None)

    def _marker(self, key: Hashable, body: Body, now: rospy.Time) -> Marker:
        ns, number = cast(Tuple[str, int], key)
        marker = Marker(header=header(self._frame, now), ns=ns, id=number, action=Marker.ADD)
        marker.pose = Pose(Point(*body.frame.position), Quaternion(*body.frame.quaternion()))
        marker.color = ColorRGBA(*body.colour)
        if isinstance(body.shape, Box):
            marker.type, marker.scale = Marker.CUBE, Vector3(*body.shape.size)
        elif isinstance(body.shape, Cylinder):
            width = 2.0 * body.shape.radius
            marker.type, marker.scale = Marker.CYLINDER, Vector3(width, width, body.shape.height)
        elif isinstance(body.shape, Sphere):
            width = 2.0 * body.shape.radius
            marker.type, marker.scale = Marker.SPHERE, Vector3(width, width, width)
        return marker


def obstacle_from_marker(marker: Marker, frame: str) -> Body:
    """Return the solid a marker stands for.

    Raises:
        InvalidMessage: It is in another frame, of another type, or holds a size or pose that means nothing.
    """
    check_frame_is(frame, marker.header.frame_id)
    position = [marker.pose.position.x, marker.pose.position.y, marker.pose.position.z]
    if not all(abs(value) <= WORLD for value in position):  # False for NaN
        raise InvalidMessage(f"position {tuple(position)} is not within {WORLD:g} m of the world's middle")
    q = marker.pose.orientation
    check_finite(**{f"orientation.{name}": getattr(q, name) for name in "xyzw"})
    # RViz takes a quaternion that nobody filled in for no rotation.
    quaternion = (q.x, q.y, q.z, q.w) if any((q.x, q.y, q.z, q.w)) else (0.0, 0.0, 0.0, 1.0)
    colour = (marker.color.r, marker.color.g, marker.color.b, marker.color.a or 1.0)
    name = f"{marker.ns}/{marker.id}" if marker.ns else f"obstacle/{marker.id}"
    return Body(name, _shape(marker), Frame.from_quaternion(position, quaternion), colour=colour)


def _shape(marker: Marker) -> Shape:
    scale: List[float] = [marker.scale.x, marker.scale.y, marker.scale.z]
    if not all(SMALLEST <= side <= LARGEST for side in scale):
        raise InvalidMessage(f"scale {tuple(scale)}; each side must be {SMALLEST:g} to {LARGEST:g} m")
    if marker.type == Marker.CUBE:
        return Box((scale[0], scale[1], scale[2]))
    if marker.type == Marker.CYLINDER and _equal(scale[:2]):
        return Cylinder(scale[0] / 2.0, scale[2])
    if marker.type == Marker.SPHERE and _equal(scale):
        return Sphere(scale[0] / 2.0)
    if marker.type in (Marker.CYLINDER, Marker.SPHERE):
        raise InvalidMessage(f"scale {tuple(scale)}; it must be as wide as deep, for only round ones are simulated")
    raise InvalidMessage(f"type {marker.type} is not simulated; it must be CUBE, CYLINDER or SPHERE")


def _equal(sides: List[float]) -> bool:
    return max(sides) - min(sides) <= 1e-6 * max(sides)
