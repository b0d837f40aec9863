"""The TurtleBot3 burger in numbers: where its parts are and what they weigh. config/robot has the same as a URDF."""

from __future__ import annotations

from mbf_relay.simulation.frames import Frame

BASE_HEIGHT = 0.010
"""Height (m) of base_link above base_footprint."""

BODY_SIZE = (0.140, 0.140, 0.143)
BODY_CENTER = (-0.032, 0.0, 0.070)
BODY_MASS = 0.825
BODY_INERTIA = (2.2e-3, 2.1e-3, 2.0e-3)

WHEEL_RADIUS = 0.033
WHEEL_WIDTH = 0.018
WHEEL_MASS = 0.0285
WHEEL_SEPARATION = 0.160
WHEEL_HEIGHT = 0.023
"""Height (m) of the wheels' axis above base_link."""

CASTER_SIZE = (0.030, 0.009, 0.020)
CASTER_CENTER = (-0.081, 0.0, -0.004)
CASTER_MASS = 0.005
CASTER_RADIUS = 0.010
"""The caster's foot is a ball (m) that just touches the ground; the box of the description would stand 4 mm in it."""

LIDAR_RADIUS, LIDAR_HEIGHT, LIDAR_MASS = 0.055, 0.0315, 0.114
LIDAR_CENTER = (-0.017, 0.0, 0.172)
SCAN_IN_BASE = Frame.of(-0.032, 0.0, 0.172)
IMU_IN_BASE = Frame.of(-0.032, 0.0, 0.068)

JOINTS = ("wheel_left_joint", "wheel_right_joint")
SCAN_FRAME, IMU_FRAME, BASE_FRAME, FOOTPRINT_FRAME, ODOM_FRAME = "base_scan", "imu_link", "base_link", "base_footprint", "odom"

FOOTPRINT = ((-0.105, -0.105), (-0.105, 0.105), (0.041, 0.105), (0.041, -0.105))
"""Outline (m) that the tutorials' costmap files give the burger, in base_footprint."""
