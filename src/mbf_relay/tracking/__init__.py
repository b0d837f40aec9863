"""Detection and tracking of moving objects in laser scans: clusters, constant-velocity Kalman filters, tracks."""
