"""Pictures of a simulation: they show what is there and change nothing."""

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.pictures import SIZE, save_pictures, take_pictures, view_following, view_from_above  # noqa: E402
from mbf_relay.simulation.shapes import Body, Box  # noqa: E402
from mbf_relay.simulation.world import World  # noqa: E402

RED = (1.0, 0.0, 0.0, 1.0)


def simulation():
    crate = Body("crate", Box((0.6, 0.6, 0.6)), Frame.of(1.5, 0.5, 0.3), colour=RED)
    return Simulation(World("test", (crate,), Pose2D(0.0, 0.0, 0.0)), SimulationParameters(), 1)


def reddish(picture):
    pixels = picture.astype(int)
    return (pixels[:, :, 0] > 60) & (pixels[:, :, 0] > 3 * pixels[:, :, 1]) & (pixels[:, :, 0] > 3 * pixels[:, :, 2])


def test_the_crate_is_seen_where_it_stands():
    with simulation() as made:
        above, following = take_pictures(made, [view_from_above(made), view_following(made)])
    assert above.shape == following.shape == (SIZE[1], SIZE[0], 3) and above.dtype == np.uint8
    rows, columns = np.nonzero(reddish(above))
    # The crate is to the right of the robot, at +x, and above it, at +y.
    assert len(rows) > 1000 and columns.mean() > SIZE[0] / 2.0 and rows.mean() < SIZE[1] * 0.55
    rows, columns = np.nonzero(reddish(following))
    # Over the robot's shoulder it is ahead to the left.
    assert len(rows) > 1000 and columns.mean() < SIZE[0] / 2.0


def test_a_picture_changes_nothing(tmp_path):
    with simulation() as made, simulation() as other:
        for step in range(240):
            if step == 100:
                paths = save_pictures(made, str(tmp_path / "new"))
            first, second = made.step(), other.step()
            assert (first.scan is None) == (second.scan is None)
            if first.scan is not None:
                assert np.array_equal(first.scan.ranges, second.scan.ranges)
        assert made.true_pose == other.true_pose
    assert len(paths) == 2 and all(path.endswith(".png") for path in paths)
