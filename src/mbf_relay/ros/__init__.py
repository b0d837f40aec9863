"""The ROS edge: nodes, clients, and conversions between messages and the package's own types."""

try:
    import roslib.launcher
except ImportError:
    pass
else:
    # dynamic_reconfigure's modules call load_manifest(), which under catkin has nothing to do but reads manifests and
    # complains on stderr wherever `rosdep init` was never run. Told that it was called already, it returns at once.
    roslib.launcher._bootstrapped.append("dynamic_reconfigure")
