"""The ROS edge: nodes, clients, and conversions between messages and the package's own types."""
