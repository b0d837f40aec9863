"""What a worlds file says and can hardly mean."""

import json
import math

import pytest

from mbf_relay.simulation.worlds import load_world

WAY = {"goal": [10.0, 0.0, 0.0], "goal_radius": 1.0}


def told(tmp_path, **changes):
    """Return the warnings of a world of these entries."""
    world = {"name": "w", "start": [0.0, 0.0, 0.0], **changes}
    (tmp_path / "worlds.json").write_text(json.dumps({"worlds": [world]}))
    return load_world(str(tmp_path / "worlds.json")).warnings


@pytest.mark.parametrize("changes, what", [
    ({"start": [0, 0, 90]}, "the yaw of the start of world w is 90 rad; if degrees are meant, write 1.5708"),
    ({**WAY, "goal": [10, 0, -180]}, "the yaw of the goal of world w is -180 rad; if degrees are meant, write -3.1416"),
    ({"boxes": [[2, 0, 45, 1, 1, 1], [4, 0, 30, 1, 1, 1]]},
     "the yaw of a box of world w is 45 rad; if degrees are meant, write 0.7854"),
])
def test_a_heading_in_degrees_is_told(tmp_path, changes, what):
    """90 was taken for 14 turns and 2 rad: the robot looked back, and walls stood askew."""
    assert told(tmp_path, **changes) == (what,)


def test_a_good_way_shorter_than_any_is_told_before_scores_are_made_of_it(tmp_path):
    """A path length in another unit, or of another goal, made SPL 0.1 of a straight drive, and its score an eighth."""
    assert told(tmp_path, **WAY, reference_path_length=1) == (
        "reference_path_length of world w is 1 m; straight from start to within goal_radius of the goal it is 9 m, so "
        "that score and SPL are too low",)


@pytest.mark.parametrize("changes", [
    {**WAY, "reference_path_length": 9.0}, {**WAY, "start": [0, 0, -2 * math.pi]}, {"reference_path_length": 0.1},
    {"boxes": [[2, 0, 3.14159, 1, 1, 1]]},
])
def test_of_what_may_well_be_meant_nothing_is_said(tmp_path, changes):
    assert told(tmp_path, **changes) == ()
