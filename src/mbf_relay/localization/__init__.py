"""Localization: where on the map the robot is, by a particle filter over scans and odometry."""
