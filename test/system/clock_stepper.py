#!/usr/bin/env python3
"""Passes a simulator's clock and readings on in another time, which is set, or stands, while it runs."""

import functools

import rospy
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, Float64
from tf2_msgs.msg import TFMessage

from mbf_relay.ros.common.rospy_patches import receiving, sending

BEGIN = 1000.0
"""Seconds added at first, so that there is a time before."""


class ClockStepper:
    def __init__(self):
        self.ahead, self.paused = rospy.Duration(BEGIN), False
        self.publishers = {
            topic: rospy.Publisher(topic, kind, queue_size=10, tcp_nodelay=True)
            for topic, kind in (("/clock", Clock), ("/tf", TFMessage), ("scan", LaserScan), ("odom", Odometry))
        }
        rospy.Subscriber("clock_step", Float64, self.step)
        rospy.Subscriber("clock_pause", Bool, self.pause)
        for topic, publisher in self.publishers.items():
            take = functools.partial(self.pass_on, publisher)
            rospy.Subscriber(f"/true/{topic.strip('/')}", publisher.data_class, take, queue_size=10, tcp_nodelay=True)

    def pause(self, message):
        self.paused = message.data

    def step(self, message):
        self.ahead += rospy.Duration(message.data)

    def pass_on(self, publisher, message):
        if publisher.data_class is Clock and self.paused:
            return
        if publisher.data_class is Clock:
            message.clock += self.ahead
        for header in [each.header for each in getattr(message, "transforms", [message]) if hasattr(each, "header")]:
            header.stamp += self.ahead
        publisher.publish(message)


if __name__ == "__main__":
    receiving.apply_patches()
    sending.apply_patches()
    rospy.init_node("clock_stepper")
    stepper = ClockStepper()
    rospy.spin()
