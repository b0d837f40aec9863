"""Localization of the robot on the map by a particle filter over scans and odometry.

    localizer.py       the filter: when to update, in which order the stages run
    motion_models.py   propagate        (sample_motion_model_odometry and its omnidirectional sister)
    laser_models.py    reweight         (beam_range_finder_model, likelihood_field_range_finder_model)
    odometry_watch.py  detects odometry that was reset while the robot goes on
    resampling.py      resample         (KLD-adaptive, with random poses where the likelihood has dropped)
    cloud_scan.py      converts a point cloud to a scan
    estimate.py        estimate         (clusters, mean and covariance)
    tracker.py         the robust form: predict, correct, doubt, decide
      lever_arm.py       online calibration of the lidar's offset from where tf has it
      scan_proposal.py   a proposal distribution that uses the scan, for sparse scans and poor odometry
      hypotheses.py      rival poses with the evidence of all scans since they were found, by evidence.py
      scan_search.py     one-scan global localization: all places on the map where a scan fits
      changed_blocks.py  blocks of the map that have changed
      reliability.py     the probability that the pose is right
    replay.py          runs the filter on recorded logs (command.py: localize_log.py)

With ``robust`` off the filter does what amcl does (navigation, noetic-devel), except for (see test_amcl_fidelity.py):

    cells       lie where costmap_2d and the map message have them; amcl's lie half a cell up and right of that
    occupancy   from 65 occupied, to 25 free; amcl knows 100 and 0 alone, which most mapping tools hardly write
    origin      its yaw counts; amcl drops it
    infinity    is a max reading to the beam model; amcl gives it no likelihood
    skipping    counts beams that came back; amcl counts those that did not among the unexplained
    drawing     is low-variance and ends at the KLD limit; amcl draws independently, and one particle more
    headings    that differ by full turns are in one bin of the histogram; in amcl they are not
    recovery    the average likelihood is not divided by the number of particles a second time
    estimates   come at every update, from the weighted particles; amcl's at every resampling, from the resampled ones
    beams       count from where the lidar was when it took each, once it is known which came first; amcl takes them all
                from where it was at the scan's stamp (mbf_relay/scan_timing.py; with ``robust``, too)
    new maps    and new parameters leave the particles where they are; amcl starts again at the last saved pose
    odometry    that was reset (odometry_watch.py) leaves the pose where the scan fits; amcl follows the odometry
    bad input   (poses off the map, scans and odometry that are not finite) is refused; amcl takes it

The chapters, tables and pages cited are those of Thrun, Burgard, Fox: Probabilistic Robotics (2005).
"""
