"""What a browser is shown and may ask for: layers and their encoding, wishes judged at the door, rights, waypoints."""
