"""The web view without ROS: layers and their encoding, validation of browsers' messages, rights, waypoints."""
