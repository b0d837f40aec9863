"""Action client and server by actionlib's protocol, timed by the wall clock; goals end when their client is gone."""
