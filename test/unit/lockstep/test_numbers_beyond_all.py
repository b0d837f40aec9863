"""A robot given a number beyond all reason drives, or is told in a sentence: no memory is asked for that nobody has."""

import pytest

pytest.importorskip("pybullet")

import faulty_drive  # noqa: E402
from tally import trial  # noqa: E402

from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402

DWA = "move_base_flex.DWAPlannerROS"
NUMBERS = [
    (f"{DWA}.sim_granularity", "1.0e-9"), (f"{DWA}.vx_samples", "2147483647"), (f"{DWA}.sim_time", "1.0e+5"),
    (f"{DWA}.acc_lim_x", "1.0e-9"), ("move_base_flex.local_costmap.footprint_padding", "1.0e+5"),
    ("move_base_flex.local_costmap.obstacle_range", "1.0e+300"), ("amcl.odom_alpha1", ".inf"),
    ("amcl.laser_likelihood_max_dist", ".inf"), ("amcl.max_particles", "2147483647"),
]


@pytest.mark.parametrize("name, value", NUMBERS)
@trial("drives with a number beyond all reason")
def test_a_robot_given_a_number_beyond_all_reason_drives_or_says_which_it_is(monkeypatch, name, value):
    try:
        monkeypatch.setattr(faulty_drive, "SETUP", make_setup(config_folder(), changes=[f"{name}={value}"]))
    except ValueError as error:
        assert name.rsplit(".", 1)[-1] in str(error) and "\n" not in str(error)
        return
    drive = faulty_drive.FaultyDrive(1)
    try:
        drive.step_until(lambda: drive.goal.done, 1.0)
        if drive.goal.done:
            assert "can be looked at" in drive.goal.result.message
    finally:
        drive.close()
