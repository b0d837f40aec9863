"""The ROS 1 navigation stack in one package: world, map, localization, costmaps, planning, control, and a move_base."""
