"""Reports of a drive: what happened, as numbers, as a picture and as a page. No ROS here."""
