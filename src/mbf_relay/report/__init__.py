"""Reports of a drive: metrics, a picture, an HTML page and output on a terminal; without ROS."""
