"""A robot that turns or slides past its goal becomes slower, one that does not stays as fast as it was."""

from mbf_relay.control.turning import LEAST_SPEED, LEAST_TURN, SOON, Overshoot


def test_a_robot_that_swings_about_its_goal_turns_ever_slower():
    overshoot = Overshoot()
    shares = [overshoot.turn_share(0.1 * cycle, -((-1.0) ** cycle), (-1.0) ** cycle) for cycle in range(8)]
    assert shares[:4] == [1.0, 0.5, 0.25, 0.125] and shares[-1] == LEAST_TURN
    overshoot.reset()
    assert overshoot.turn_share(1.0, 0.0, 1.0) == 1.0


def test_a_robot_that_turns_the_other_way_later_or_on_the_same_way_is_not_slowed_down():
    overshoot = Overshoot()
    for cycle in range(20):
        assert overshoot.turn_share(0.1 * cycle, 0.1 * cycle, 2.0 - 0.1 * cycle) == 1.0
    assert overshoot.turn_share(1.9 + SOON + 0.1, 2.5, -0.5) == 1.0


def test_a_robot_whose_way_swings_round_it_is_not_slowed_down_for_the_rest_of_it():
    overshoot = Overshoot()
    for cycle in range(20):
        assert overshoot.turn_share(0.1 * cycle, 0.0, (-1.0) ** cycle) == 1.0


def test_a_robot_that_gave_way_to_somebody_in_between_is_not_slowed_down():
    overshoot = Overshoot()
    for cycle in range(8):
        assert overshoot.turn_share(0.1 * cycle, -((-1.0) ** cycle), (-1.0) ** cycle) == 1.0
        overshoot.interrupted()


def test_a_robot_that_slides_past_its_goal_comes_back_slower():
    overshoot = Overshoot()
    for _ in range(5):
        overshoot.slid()
    assert overshoot.speed_share == LEAST_SPEED


def test_a_robot_that_is_led_another_way_is_not_slowed_down():
    """It had turned a little past its path when another one lay behind it, and crept round to that."""
    overshoot = Overshoot()
    for cycle in range(8):
        side, heading = (-1.0) ** cycle, 0.1 * (-1.0) ** cycle
        assert overshoot.turn_share(0.1 * cycle, heading, -1.5 * side) == 1.0
        assert overshoot.turn_share(0.1 * cycle + 0.05, heading, -0.1 * side) == 1.0


def test_a_robot_that_is_turned_away_from_a_place_behind_it_has_not_turned_past_it():
    overshoot = Overshoot()
    assert overshoot.turn_share(0.0, 0.0, 3.0) == 1.0
    assert overshoot.turn_share(0.5, -0.8, -2.5) == 1.0
