"""Localization: where on the map the robot is, by a particle filter over scans and odometry.

    localizer.py       the filter's life: when to update, in which order the stages run
    motion_models.py   propagate        (sample_motion_model_odometry and its omnidirectional sister)
    laser_models.py    reweight         (beam_range_finder_model, likelihood_field_range_finder_model)
    resampling.py      resample         (KLD-adaptive, with random poses where the fit has dropped)
    estimate.py        estimate         (clusters, mean and covariance)
    scan_proposal.py   the proposal that looks at the scan, for sparse scans and poor odometry; scouts.py, where it fails
    replay.py          recorded logs through the filter (command.py: localize_log.py)

The chapters, tables and pages cited are those of Thrun, Burgard, Fox: Probabilistic Robotics (2005).
"""
