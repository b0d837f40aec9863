"""A robot whose lidar measures nothing nearer than 0.3 m, as most depth cameras, drives through gaps that are narrower.
"""

from pathlib import Path

import pytest

pytest.importorskip("pybullet")

from tally import LONG  # noqa: E402

from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import task_of  # noqa: E402
from mbf_relay.simulation.generators import generate  # noqa: E402
from mbf_relay.simulation.worlds_file import world_of  # noqa: E402


@pytest.mark.parametrize("seed", (905020, 905038, 905010, 905030) if LONG else (905038,))
def test_a_robot_whose_lidar_sees_nothing_near_arrives_as_one_whose_does(seed):
    """It stood for good once something hid a sixth of what lies ahead, and nothing it was allowed to do led away."""
    setup = make_setup(config_folder(), changes=["simulator.scan_range_min=0.3"], has_map=False)
    result = Episode(task_of(world_of(Path("generated"), 0, generate("barn", seed))), setup, 1).run()
    assert result.success and result.contacts == 0, (result.outcome, result.message, result.contacts)
