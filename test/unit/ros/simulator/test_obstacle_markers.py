"""What is made of markers that put obstacles into the simulated world."""

import pytest

pytest.importorskip("visualization_msgs")
pytest.importorskip("pybullet")

from std_msgs.msg import Header  # noqa: E402
from visualization_msgs.msg import Marker  # noqa: E402

from mbf_relay.ros.common.checks import InvalidMessage  # noqa: E402
from mbf_relay.ros.simulator.obstacles import obstacle_from_marker  # noqa: E402


@pytest.mark.parametrize("frame", ["odom", pytest.param("a" * 2000000, id="endless")])
def test_an_obstacle_in_another_frame_is_refused_without_filling_the_log(frame):
    with pytest.raises(InvalidMessage, match="frame '.*'; it must be 'world'") as refusal:
        obstacle_from_marker(Marker(header=Header(frame_id=frame)), "world")
    assert len(str(refusal.value)) < 300
