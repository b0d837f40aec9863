"""Localization: where on the map the robot is, by a particle filter over scans and odometry.

    localizer.py       the filter's life: when to update, in which order the stages run
    motion_models.py   propagate        (sample_motion_model_odometry and its omnidirectional sister)
    laser_models.py    reweight         (beam_range_finder_model, likelihood_field_range_finder_model)
    odometry_watch.py  odometry that begins anew while the robot goes on
    resampling.py      resample         (KLD-adaptive, with random poses where the fit has dropped)
    cloud_scan.py      a scan out of a point cloud
    estimate.py        estimate         (clusters, mean and covariance)
    tracker.py         the robust form: predict, correct, doubt, decide
      lever_arm.py       how far from its place the lidar is mounted, learnt on the drive
      scan_proposal.py   particles drawn with the scan in view, for sparse scans and poor odometry
      hypotheses.py      rival places with the evidence of all scans since they came up; evidence.py weighs them
      scan_search.py     one-scan global localization: all places on the map where a scan fits
      changed_blocks.py  where the map is not what it was
      reliability.py     the probability that the pose is right
    replay.py          recorded logs through the filter (command.py: localize_log.py)

With ``robust`` off the filter does as amcl (navigation, noetic-devel), but for these (see test_amcl_fidelity.py):

    cells       lie where costmap_2d and the map message have them; amcl's lie half a cell up and right of that
    occupancy   from 65 occupied, to 25 free; amcl knows 100 and 0 alone, which most mapping tools hardly write
    origin      its yaw counts; amcl drops it
    infinity    is a max reading to the beam model; amcl gives it no likelihood
    skipping    counts beams that came back; amcl counts those that did not among the unexplained
    drawing     spread evenly over the weights, and it ends at the KLD limit; amcl's draws are independent, and one more
    headings    that differ by whole turns are equal in the histogram; amcl lets them drift apart
    doubt       the average likelihood is not divided by the number of particles a second time
    estimates   come at every update, from the weighed particles; amcl has them at every drawing, from the drawn ones
    beams       count from where the lidar was when it took each, once it is known which came first; amcl takes them all
                from where it was at the scan's stamp (mbf_relay/scan_timing.py; with ``robust``, too)
    new maps    and new parameters leave the particles where they are; amcl starts again at the last saved pose
    odometry    that begins anew (odometry_watch.py) leaves the robot where its scan fits; amcl goes where that leads
    bad input   (poses off the map, scans and odometry that are no numbers) is refused; amcl takes it

The chapters, tables and pages cited are those of Thrun, Burgard, Fox: Probabilistic Robotics (2005).
"""
