"""Costmaps under ROS; part of the server."""
