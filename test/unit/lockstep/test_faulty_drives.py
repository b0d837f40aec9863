"""What a robot does when its sensors fail on the way.

It stands before it touches anything, says why, and goes on after.
"""

import numpy as np
import pytest

pytest.importorskip("pybullet")

from faulty_drive import FaultyDrive  # noqa: E402
from tally import LONG, trial  # noqa: E402

from mbf_relay.geometry import STOP, Pose2D, angle_between  # noqa: E402
from mbf_relay.lockstep.tasks import circle  # noqa: E402
from mbf_relay.navigation.goals import FramedPose, NavigateGoal  # noqa: E402
from mbf_relay.navigation.task import Ending  # noqa: E402
from mbf_relay.simulation.faults import NO_FAULTS, Faults  # noqa: E402
from mbf_relay.simulation.shapes import Cylinder  # noqa: E402

FAILING = "drives whose sensors, odometry, commands or clock fail"
SEEDS = range(1, 6) if LONG else (1,)


@pytest.fixture(params=[(seed, 1) for seed in SEEDS], ids=map(str, SEEDS))
def drive(request):
    made = FaultyDrive(*request.param)
    yield made
    made.close()


NEARER = pytest.mark.parametrize("drive", [(seed, 0) for seed in SEEDS], ids=map(str, SEEDS), indirect=True)
"""Drives to the first goal, which is half as far, for what goes wrong at once."""


def all_read(value):
    return lambda scan: scan.__class__(**{**vars(scan), "ranges": np.full(len(scan.ranges), value)})


LIDAR_FAULTS = {
    "frozen": (Faults(lidar_frozen=True), None), "half dead": (Faults(dead_beams=0.5), None),
    "sector dead": (Faults(dead_beams=0.1, dead_beams_start=-0.3), None), "all zero": (Faults(dead_beams=1.0), None),
    "all at range_max": (NO_FAULTS, all_read(3.5)), "all infinite": (NO_FAULTS, all_read(np.inf)),
    "all NaN": (NO_FAULTS, all_read(np.nan)),
}


@pytest.mark.parametrize("name", LIDAR_FAULTS)
@NEARER
@trial(FAILING)
def test_a_robot_whose_lidar_fails_stands_before_the_box_it_cannot_see_and_goes_on_later(drive, name):
    assert drive.step_until(drive.is_driving, 20.0), "it never drove"
    began = drive.now
    drive.simulation.faults, change = LIDAR_FAULTS[name]
    drive.change_scan = change or drive.change_scan
    drive.set_down_ahead(0.6)
    assert drive.step_until(lambda: drive.commands[-1][1] == STOP, 2.0), "it drove on blindly"
    assert drive.now - began <= 0.5 + 1e-6
    drive.step_until(lambda: False, 3.0)
    assert all(velocity == STOP for now, velocity in drive.commands if now > began + 0.6)
    assert any("lidar" in text for text in drive.said), drive.said
    drive.simulation.scene.remove_obstacle("box")
    drive.simulation.faults, drive.change_scan = NO_FAULTS, lambda scan: scan
    assert drive.step_until(lambda: drive.goal.done, 60.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@NEARER
@trial(FAILING)
def test_a_robot_whose_lidar_falls_silent_stands_within_half_a_second(drive):
    assert drive.step_until(drive.is_driving, 20.0)
    began, drive.simulation.faults = drive.now, Faults(lidar_silent=True)
    assert drive.step_until(lambda: drive.commands[-1][1] == STOP, 2.0)
    assert drive.now - began <= 0.5 + 1e-6
    drive.step_until(lambda: False, 0.5)
    assert any("lidar" in text for text in drive.said), drive.said
    drive.simulation.faults = NO_FAULTS
    assert drive.step_until(lambda: drive.goal.done, 60.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@pytest.mark.parametrize("name", ["half the rate", "slip", "a dead rear", "every second beam", "sunlight", "dust"])
@trial(FAILING)
def test_a_robot_drives_on_with_what_harms_little(drive, name):
    kept = []

    def every_second(scan):
        kept.append(scan)
        return scan if len(kept) % 2 else None

    def thinned(scan):
        ranges = scan.ranges.copy()
        ranges[::2] = 0.0
        return scan.__class__(**{**vars(scan), "ranges": ranges})

    drive.simulation.faults = {
        "slip": Faults(slip=0.3), "a dead rear": Faults(dead_beams=0.25, dead_beams_start=2.4),
        "sunlight": Faults(short_readings=0.01), "dust": Faults(short_readings=0.1),
    }.get(name, NO_FAULTS)
    drive.change_scan = {"half the rate": every_second, "every second beam": thinned}.get(name, drive.change_scan)
    assert drive.step_until(lambda: drive.goal.done, 120.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@pytest.mark.parametrize("distance", [0.5, 0.8])
@pytest.mark.parametrize("delay", [0.3, 0.5])
@NEARER
@trial(FAILING)
def test_a_robot_whose_commands_come_late_touches_nothing_and_arrives_once_they_come_in_time(drive, delay, distance):
    assert drive.step_until(drive.is_driving, 20.0)
    drive.simulation.faults = Faults(command_delay=delay)
    drive.set_down_ahead(distance)
    drive.step_until(lambda: drive.goal.done, 10.0)
    assert drive.goal.ending in (None, Ending.SUCCEEDED), drive.goal.result
    drive.simulation.scene.remove_obstacle("box")
    drive.simulation.faults = NO_FAULTS
    assert drive.step_until(lambda: drive.goal.done, 60.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@pytest.mark.parametrize("delay", [0.15, 0.3, 0.5, 1.2])
@trial(FAILING)
def test_a_robot_whose_commands_always_come_late_drives_as_well_as_one_that_hears_at_once(drive, delay):
    """It swung about its way and its goal, and at half a second it seldom arrived at all."""
    drive.simulation.faults = Faults(command_delay=delay)
    assert drive.step_until(lambda: drive.goal.done, 17.5 + delay), "it takes 16.5 s where commands come at once"
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result
    assert drive.simulation.true_pose.distance_to(circle().goals[1]) < 0.1


@pytest.mark.parametrize("late", [0.2, 0.3, 0.45])
@trial(FAILING)
def test_a_robot_whose_transform_comes_later_than_its_odometry_arrives_all_the_same(drive, monkeypatch, late):
    """It took the place where it had been for the one where it was, circled its goal, and was given up beside it."""
    robot = drive.navigator.robot
    monkeypatch.setattr(type(robot), "base_in_odom", property(
        lambda self: self.odometry_at(max(self._odometry[0][0], self.odometry_stamp - late))))
    monkeypatch.setattr(robot, "pose_ahead", lambda frame: -late, raising=False)
    assert drive.step_until(lambda: drive.goal.done, 17.5), "it takes 16.5 s where the transform comes at once"
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result
    assert drive.simulation.true_pose.distance_to(circle().goals[1]) < 0.1


@trial(FAILING)
def test_a_robot_whose_commands_came_late_for_a_while_does_not_creep_to_its_goal_for_the_rest_of_it(drive):
    """It turned to its heading at a sixteenth of its speed, and was given up as oscillating."""
    drive.simulation.faults = Faults(command_delay=0.6)
    drive.step_until(lambda: False, 6.0)
    drive.simulation.faults = NO_FAULTS
    assert drive.step_until(lambda: drive.goal.done, 13.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@pytest.mark.parametrize("delay, late_for", [(0.5, 0.4), (0.9, 0.2), (1.3, 0.02)])
@trial(FAILING)
def test_a_robot_whose_commands_came_late_only_at_first_is_where_it_says_it_has_arrived(drive, delay, late_for):
    """It stopped a second's way short of its goal, where it would have come to if they still had come late."""
    drive.goal.cancel()
    drive.step_until(lambda: drive.goal.done, 1.0)
    start = drive.simulation.true_pose
    goal = start.compose(Pose2D(0.6, 0.0, 0.0))
    drive.goal = drive.navigate(NavigateGoal(FramedPose(goal, drive.map_frame)))
    drive.simulation.faults = Faults(command_delay=delay)
    drive.step_until(lambda: drive.simulation.true_pose.distance_to(start) > late_for, 5.0)
    drive.simulation.faults = NO_FAULTS
    assert drive.step_until(lambda: drive.goal.done, 20.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result
    assert drive.simulation.true_pose.distance_to(goal) < 0.06


@pytest.mark.parametrize("slip", [0.0, 0.3])
@pytest.mark.parametrize("distance", [0.35, 0.5, 0.8])
@NEARER
@trial(FAILING)
def test_a_robot_before_which_something_is_set_down_does_not_push_it(drive, distance, slip):
    drive.simulation.faults = Faults(slip=slip)
    assert drive.step_until(drive.is_driving, 20.0)
    drive.set_down_ahead(distance)
    drive.step_until(lambda: drive.goal.done, 60.0)
    assert drive.goal.done


@pytest.mark.parametrize("distance", [0.35, 0.5, 0.8])
@NEARER
@trial(FAILING)
def test_a_robot_before_which_a_table_is_set_down_in_dust_touches_no_leg(drive, distance):
    drive.simulation.faults = Faults(short_readings=0.1)
    assert drive.step_until(drive.is_driving, 20.0)
    for name, aside in (("left", 0.15), ("middle", 0.0), ("right", -0.15)):
        there = drive.simulation.true_pose.compose(Pose2D(distance, aside, 0.0))
        drive.set_down(name, Cylinder(0.01, 0.4), there, 0.2)
    drive.step_until(lambda: drive.goal.done, 40.0)


ODOMETRY_FAULTS = {
    "late by 0.2 s": (Faults(odom_delay=0.2), None), "late by 1 s": (Faults(odom_delay=1.0), "s old"),
    "late by 5 s": (Faults(odom_delay=5.0), "s old"), "silent": (Faults(odom_silent=True), "s old"),
    "frozen": (Faults(odom_frozen=True), "odometry repeats"), "jumping": (Faults(odom_jump=2.0), None),
}
"""Each with words that the goal or its feedback must say, None where the robot may well drive on."""


@pytest.mark.parametrize("name", ODOMETRY_FAULTS)
@NEARER
@trial(FAILING)
def test_a_robot_whose_odometry_fails_touches_nothing_says_why_and_goes_on_later(drive, name):
    fault, words = ODOMETRY_FAULTS[name]
    assert drive.step_until(drive.is_driving, 20.0), "it never drove"
    drive.simulation.faults = fault
    drive.step_until(lambda: drive.goal.done, 8.0)
    if words is not None:
        said = drive.said | ({drive.goal.result.message} if drive.goal.done else set())
        assert any(words in text for text in said), said
    drive.simulation.faults = NO_FAULTS
    drive.arrive()


@pytest.mark.parametrize("seconds", [2.0, 6.0, 12.0])
@NEARER
@trial(FAILING)
def test_a_robot_whose_radio_fails_for_a_while_stands_and_drives_on_to_its_goal(drive, seconds):
    """Its goal was ended after a second, where under move_base the robot stood and waited."""
    assert drive.step_until(drive.is_driving, 20.0), "it never drove"
    began, drive.simulation.faults = drive.now, Faults(odom_silent=True, lidar_silent=True)
    drive.step_until(lambda: False, seconds)
    assert all(velocity == STOP for now, velocity in drive.commands if now > began + 1.2)
    drive.simulation.faults = NO_FAULTS
    assert drive.step_until(lambda: drive.goal.done, 40.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result


@trial(FAILING)
def test_a_robot_whose_odometry_froze_while_it_turned_goes_on_through_the_ghosts_it_has_seen():
    """Costmaps were drawn with a wrong heading, and one wall of theirs stands on the goal, behind a pillar."""
    drive = FaultyDrive(5)
    try:
        drive.step_until(drive.is_driving, 20.0)
        drive.simulation.faults = ODOMETRY_FAULTS["frozen"][0]
        drive.step_until(lambda: drive.goal.done, 8.0)
        drive.simulation.faults = NO_FAULTS
        drive.arrive()
    finally:
        drive.close()


@pytest.mark.parametrize("seconds", [100.0, -0.9])
@NEARER
@trial(FAILING)
def test_a_robot_whose_clock_is_set_touches_nothing_and_goes_on(drive, seconds):
    assert drive.step_until(drive.is_driving, 20.0), "it never drove"
    parameters = drive.simulation.parameters
    drive.simulation.parameters = parameters.replace(start_time=parameters.start_time + seconds)
    drive.arrive()


@NEARER
@trial(FAILING)
def test_a_robot_before_which_people_cross_touches_nobody_and_arrives(drive):
    assert drive.step_until(drive.is_driving, 20.0), "it never drove"
    for side in (1.0, -1.0):
        robot, began = drive.simulation.true_pose, drive.now
        while drive.now - began < 3.0:
            there = robot.compose(Pose2D(0.8, side * (0.9 - 0.6 * (drive.now - began)), 0.0))
            drive.set_down("person", Cylinder(0.15, 1.0), there, 0.5)
            drive.step_until(lambda: False, 0.1)
        drive.simulation.scene.remove_obstacle("person")
    drive.arrive()


def learn_the_delay(drive):
    """Have a robot whose commands come 0.8 s late learn it on its way, and stand."""
    drive.simulation.faults = Faults(command_delay=0.8)
    assert drive.step_until(drive.is_driving, 20.0)
    drive.step_until(lambda: False, 2.0)
    drive.goal.cancel()
    drive.step_until(lambda: False, 2.0)


@pytest.mark.parametrize("room", [0.1, 0.14, 0.3])
@trial(FAILING)
def test_a_robot_whose_commands_come_late_backs_up_no_farther_than_is_free(drive, room):
    learn_the_delay(drive)
    drive.set_down_ahead(-0.136 - 0.1 - room)  # from the burger's rear to the middle of the box
    drive.step_until(lambda: False, 1.0)
    before = drive.simulation.true_pose
    task = drive.recover("back_up")
    assert drive.step_until(lambda: task.done, 10.0)
    drive.step_until(lambda: False, 1.5)
    backed = before.distance_to(drive.simulation.true_pose)
    assert 0.3 * room < backed < room and backed < 0.2


@trial(FAILING)
def test_a_robot_thought_to_hear_late_does_not_take_a_pole_right_before_it_for_passed(drive):
    assert drive.step_until(lambda: drive.simulation.true_velocity.x > 0.2, 20.0)
    drive.step_until(lambda: False, 1.5)
    delay = drive.navigator.robot.delay
    delay.seconds, delay._judge = 1.2, lambda begin: None  # it hears at once, and could stand in time
    there = drive.simulation.true_pose.compose(Pose2D(0.041 + 0.1 + 0.015, 0.0, 0.0))
    drive.set_down("pole", Cylinder(0.015, 1.0), there, 0.5)
    drive.step_until(lambda: False, 8.0)


@pytest.mark.parametrize("delay", [0.5, 1.0, 1.45])
@trial(FAILING)
def test_a_robot_thought_to_hear_late_is_not_said_to_be_where_it_would_have_rolled(drive, delay):
    """It stood 17 cm before its goal, at 0.22 m/s, and its client heard that the goal was reached."""
    believed = drive.navigator.robot.delay
    believed.seconds, believed._judge = delay, lambda begin: None  # it hears at once
    goal = Pose2D(-0.55, -0.55, 0.0)  # which it comes to in the heading asked for, and has not to turn there
    drive.goal = drive.navigate(NavigateGoal(FramedPose(goal, drive.map_frame)))
    assert drive.step_until(lambda: drive.goal.done, 30.0)
    assert drive.goal.ending is Ending.SUCCEEDED, drive.goal.result
    assert drive.simulation.true_pose.distance_to(goal) < 0.05 + 0.015  # what localization may err by


@trial(FAILING)
def test_a_robot_whose_commands_come_late_turns_round_once_to_look(drive):
    learn_the_delay(drive)
    before = drive.simulation.true_pose
    task = drive.recover("rotate_recovery")
    assert drive.step_until(lambda: task.done, 15.0)
    drive.step_until(lambda: False, 1.5)
    assert abs(angle_between(before.theta, drive.simulation.true_pose.theta)) < 0.3
