import pytest

from mbf_relay.misspelling import nearest_of


@pytest.mark.parametrize("name, nearest", [
    ("max_vel_rot", None), ("max_vel_xx", "max_vel_x"), ("inflation_radus", "inflation_radius"),
    ("goal_tolerance", "xy_goal_tolerance"), ("alow_unknown", "allow_unknown"),
    ("linear_spd_incre", None), ("number_of_recovery_behaviors", None), ("planner_patience_time", "planner_patience"),
])
def test_a_slip_of_the_pen_is_known_from_another_name(name, nearest):
    known = ["max_vel_x", "max_vel_y", "inflation_radius", "xy_goal_tolerance", "allow_unknown", "planner_patience",
             "recovery_behavior_enabled"]
    assert nearest_of(name, known) == nearest
