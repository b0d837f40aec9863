"""Topics with the planners' paths, as of navfn and global_planner."""

from __future__ import annotations

from typing import Dict, Iterable

import rospy
from nav_msgs.msg import Path as PathMessage

from mbf_relay.planning.path import Path
from mbf_relay.ros.common.conversions import path_to_message


class PlannerTopics:
    """Publishes each planner's paths on ~NAME/plan while there are subscribers.

    Args:
        names: The planners' names.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._publishers: Dict[str, rospy.Publisher] = {}
        for name in names:
            self.add(name)

    def add(self, name: str) -> None:
        """Advertise the topic of another planner."""
        self._publishers[name] = rospy.Publisher(f"~{name}/plan", PathMessage, queue_size=1)

    def publish(self, name: str, path: Path) -> None:
        """Publish a path that planner `name` found."""
        publisher = self._publishers[name]
        if publisher.get_num_connections():
            publisher.publish(path_to_message(path, rospy.get_rostime()))
