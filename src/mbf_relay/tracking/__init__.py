"""What moves: clusters of a scan, followed by Kalman filters of constant velocity, and told apart from what stands."""
