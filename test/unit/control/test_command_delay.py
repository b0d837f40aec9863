"""How late commands reach the wheels is told from how the robot moves, and where it will be when they do."""

import numpy as np
import pytest

from mbf_relay.control.command_delay import DELAYS, GAIN, WATCHED, CommandDelay
from mbf_relay.geometry import STOP, Pose2D, Twist2D

PERIOD, STEP = 0.1, 0.01


class Wheels:
    """A robot that does what it was told `delay` seconds before, its wheels slow by `lag` (s)."""

    def __init__(self, delay, lag=0.0):
        self.delay, self.lag, self.watched = delay, lag, CommandDelay()
        self.pose, self.velocity, self.now = Pose2D(1.0, 2.0, 3.0), STOP, 0.0
        self.told = []

    def drive(self, commands):
        """Drive through commands, one a cycle; return what is believed of the delay in each (s)."""
        believed = []
        for command in commands:
            self.watched.note(self.now, self.velocity)
            believed.append(self.watched.seconds)
            self.watched.tell(self.now, command)
            for _ in range(round(PERIOD / STEP)):
                self.told.append(command)
                self._roll()
        return believed

    def _roll(self):
        late = len(self.told) - 1 - round(self.delay / STEP)
        wanted = self.told[late] if late >= 0 else STOP
        share = 1.0 if self.lag == 0.0 else STEP / self.lag
        self.velocity = Twist2D(*(was + share * (now - was) for was, now in zip(self.velocity, wanted)))
        self.pose = self.pose.compose(self.velocity.held(STEP))
        self.now += STEP


def swings(count=80, size=1.0):
    return [Twist2D(0.2 * size, 0.0, size * turn) for turn in np.sin(np.arange(count) * PERIOD * 2.0)]


def straight(count=40):
    return [Twist2D(0.2, 0.0, 0.0)] * count


@pytest.mark.parametrize("drive", [swings, straight])
@pytest.mark.parametrize("delay", [0.2, 0.3, 0.5, 0.8, 1.2])
def test_a_robot_that_hears_late_says_by_how_much(delay, drive):
    assert Wheels(delay).drive(drive())[-1] == pytest.approx(delay, abs=0.1)


@pytest.mark.parametrize("drive", [swings, straight])
def test_a_robot_that_hears_late_is_found_out_within_a_second_of_its_first_motion(drive):
    assert Wheels(0.5).drive(drive())[15] == pytest.approx(0.5, abs=0.1)


def test_a_robot_controlled_fifty_times_a_second_is_found_out_as_well():
    watched, told = CommandDelay(), []
    for cycle in range(200):
        watched.note(0.02 * cycle, told[-26] if len(told) > 25 else STOP)
        told.append(Twist2D(0.2, 0.0, np.sin(0.04 * cycle)))
        watched.tell(0.02 * cycle, told[-1])
    assert watched.seconds == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("commands, delay, lag", [
    (swings(), 0.0, 0.0), (swings(), 0.0, 0.1), (swings(size=0.001), 0.5, 0.0), (straight(), 0.0, 0.1), ([], 0.0, 0.0),
])
def test_a_robot_that_moves_when_told_or_hardly_at_all_blames_no_delay(commands, delay, lag):
    assert not any(Wheels(delay, lag).drive(commands))


def test_a_robot_that_does_not_do_what_it_is_told_at_all_blames_no_delay():
    rng = np.random.default_rng(1)
    watched = CommandDelay()
    for cycle in range(100):
        watched.note(PERIOD * cycle, Twist2D(*rng.normal(size=3)))
        watched.tell(PERIOD * cycle, Twist2D(*rng.normal(size=3)))
    assert watched.seconds == 0.0


def test_a_robot_that_somebody_holds_blames_no_delay():
    watched = CommandDelay()
    for cycle, command in enumerate(swings()):
        watched.note(PERIOD * cycle, STOP)
        watched.tell(PERIOD * cycle, command)
    assert watched.seconds == 0.0


@pytest.mark.parametrize("drive", [swings, straight])
@pytest.mark.parametrize("free", [0, 2, 5])
def test_a_robot_that_a_guard_or_a_hand_holds_as_it_sets_out_is_not_thought_to_hear_late(drive, free):
    """A guard that stopped it made its server reckon with 1.45 s, and it was taken to be where it never got to."""
    watched, seen = CommandDelay(), STOP
    for cycle, told in enumerate([STOP] * 10 + drive()):
        watched.note(PERIOD * cycle, seen if cycle <= 10 + free else STOP)
        assert watched.seconds == 0.0, cycle
        watched.tell(PERIOD * cycle, told)
        seen = told


def test_a_robot_that_was_stopped_between_its_cycles_blames_no_delay():
    """One whose computer fell behind at its start took itself for over a second late, and ended its drive 0.2 m short.
    """
    watched, standing = CommandDelay(), 7
    for cycle in range(40):
        watched.note(0.2 * cycle, STOP if cycle <= standing else Twist2D(0.2, 0.0, 0.0))
        watched.tell(0.2 * cycle, Twist2D(0.2, 0.0, 0.0))
        if cycle < standing:
            watched.tell(0.2 * cycle + 0.05, STOP)
        assert watched.seconds == 0.0


def test_a_robot_that_stands_and_drives_straight_on_still_knows_how_late_it_hears():
    robot = Wheels(0.5)
    robot.drive(swings())
    assert min(robot.drive([STOP] * 100 + straight(100))) == pytest.approx(0.5, abs=0.1)


def test_a_robot_that_hears_in_time_again_notices_it():
    robot = Wheels(0.5)
    assert robot.drive(swings())[-1] > 0.0
    robot.delay = 0.0
    assert robot.drive(swings())[-1] == 0.0


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.8])
def test_a_robot_is_where_it_was_expected_when_it_does_what_it_is_told(delay):
    robot = Wheels(delay)
    robot.drive(swings())
    robot.watched.note(robot.now, robot.velocity)
    way, believed = robot.watched.way(robot.pose, 0.01, 0.05), robot.watched.seconds
    assert np.all(np.hypot(*np.diff(way[:, :2], axis=0).T) <= 0.01 + 1e-9)
    expected = Pose2D(*way[-1])
    robot.drive(swings(count=round(believed / PERIOD)))
    assert expected.distance_to(robot.pose) < 0.025
    assert expected.theta == pytest.approx(robot.pose.theta, abs=0.11)


@pytest.mark.parametrize("age", [0.0, 0.1, 0.3])
def test_a_robot_whose_pose_comes_late_is_where_odometry_saw_it_go_since(age):
    robot, poses = Wheels(0.0), []
    for command in swings():
        poses.append(robot.pose)
        robot.drive([command])
    poses.append(robot.pose)
    robot.watched.note(robot.now, robot.velocity)
    caught_up = robot.watched.caught_up(poses[-1 - round(age / PERIOD)], age)
    assert caught_up.distance_to(robot.pose) < 1e-6
    assert caught_up.theta == pytest.approx(robot.pose.theta)


def test_a_robot_whose_odometry_comes_late_and_its_pose_does_not_has_that_much_of_its_way_behind_it():
    robot = Wheels(0.5)
    robot.drive(swings())
    robot.watched.note(robot.now, robot.velocity)
    ways = [robot.watched.way(robot.pose, 0.01, 0.05, ahead) for ahead in (0.0, 0.2, robot.watched.seconds)]
    begin, middle, end = ([*map(float, way[-1])] for way in ways)
    assert end == pytest.approx([*robot.pose])
    assert 0.2 * 0.3 * 0.8 < Pose2D(*middle).distance_to(robot.pose) < Pose2D(*begin).distance_to(robot.pose)


def test_a_clock_set_back_and_a_drive_interrupted_let_nothing_of_before_count():
    robot = Wheels(0.5)
    robot.drive(swings())
    for told_at, now in ((0.5, 1.0), (9.0, 100.0)):
        robot.watched.tell(told_at, STOP)
        robot.watched.note(now, STOP)
        assert robot.watched.way(Pose2D(1.0, 2.0, 3.0), 0.01, 0.05) == pytest.approx(np.array([[1.0, 2.0, 3.0]]))


def test_a_recovery_goes_on_that_asks_where_the_robot_will_be_while_the_wheels_are_told_to_stand():
    class Overtaken(Twist2D):
        """A velocity; while somebody looks at it, another thread tells and notes the next."""

        def look(self):
            now = watched._seen[-1][0] + PERIOD
            watched.tell(now, STOP)
            watched.note(now, STOP)

        def __iter__(self):
            self.look()
            return super().__iter__()

        def held(self, duration):
            self.look()
            return super().held(duration)

    watched, here = CommandDelay(), Pose2D(0.0, 0.0, 0.0)

    def ask(question):
        for entries in (watched._told, watched._seen):
            entries.clear()
            entries.extend((turn * PERIOD, Overtaken(0.2, 0.0, 0.0)) for turn in range(10))
        watched.seconds = 0.5
        return question()

    assert ask(lambda: watched.caught_up(here, 0.3)).x == pytest.approx(0.06)
    assert ask(lambda: watched.way(here, 0.05, 0.1))[-1, 0] == pytest.approx(0.1)
    assert ask(lambda: watched._told_at(np.array([0.55]))).tolist() == [[0.2, 0.0, 0.0]]


def test_what_was_told_lately_counts_each_velocity_for_as_long_as_it_held():
    delay = CommandDelay()
    delay.note(1.0, STOP)
    assert delay.told_lately() == STOP
    delay.tell(1.1, Twist2D(0.4, 0.0, 0.0))
    assert delay.told_lately() == Twist2D(0.4, 0.0, 0.0), "between no two cycles yet"
    delay.tell(1.2, STOP)
    delay.note(1.4, STOP)
    assert delay.told_lately() == pytest.approx(Twist2D(0.1, 0.0, 0.0))
    delay.tell(1.4, Twist2D(0.0, 0.0, -1.0))
    delay.note(1.5, STOP)
    assert delay.told_lately() == pytest.approx(Twist2D(0.0, 0.0, -1.0))


def plain_best(watched, now):
    """Return the delay (s) that leaves least unexplained of x and theta, and by how much less than the one believed."""
    rows = np.array([(time, *velocity) for time, velocity in watched._seen if time >= now - WATCHED])
    told = np.stack([watched._told_at(rows[:, 0] - delay) for delay in DELAYS])[..., [0, 2]]
    left = (np.mean((rows[:, [1, 3]] - told) ** 2, axis=1) / np.mean(told[0] ** 2, axis=0)).sum(axis=1)
    return DELAYS[np.argmin(left)], left[np.searchsorted(DELAYS, watched.seconds)] - left.min()


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_no_delay_that_explains_much_more_goes_unseen(seed, delay):
    """Where the one believed explains nearly all, the others are not tried."""
    rng = np.random.default_rng(seed)
    robot = Wheels(delay, lag=0.1)
    robot.drive([Twist2D(0.2, 0.0, turn) for turn in 0.5 * np.cumsum(rng.normal(0.0, 0.4, 100))])
    best, more = plain_best(robot.watched, robot.watched._judged_at)
    assert more < GAIN or robot.watched.seconds == pytest.approx(best)
