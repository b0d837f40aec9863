"""The whole stack in one process on one clock, without ROS: one seed gives one drive, as fast as the processor goes."""
