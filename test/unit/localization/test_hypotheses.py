import math

import numpy as np
import pytest
from synthetic_room import ORIGIN, room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.beams import pick_beams
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.evidence import Evidence, Judgement, Seen
from mbf_relay.localization.gaussians import PoseGaussian
from mbf_relay.localization.hypotheses import LEAD, PROVEN_SCANS, Hypotheses
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.reliability import Reliability
from mbf_relay.localization.scan_likelihood import ScanLikelihood
from mbf_relay.localization.tracker import HypothesisTracker
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

NARROW = np.diag([0.05, 0.05, 0.02]) ** 2
TRUTH = Pose2D(1.5, 0.5, 0.3)
ELSEWHERE = Pose2D(-1.5, 2.5, 2.0)
LASER = np.zeros(2)


class Room:
    """A room with its models and hypotheses, one of which is held."""

    def __init__(self, occupancy, held):
        field = DistanceField(occupancy, 2.0)
        self.likelihood, self.evidence = ScanLikelihood(field, 0.2), Evidence(field, 0.2)
        self.hypotheses, self.held = Hypotheses(), np.array(held)

    def add(self, *places):
        self.hypotheses.add(np.array(places), np.array([NARROW] * len(places)), self.held, -7.0)

    def see(self, occupancy, truth, way=1.0):
        beams = pick_beams(scan_at(occupancy, truth, np.random.default_rng(1)), IDENTITY, 1)
        self.hypotheses.predict(IDENTITY, np.zeros((3, 3)), way)
        return self.hypotheses.correct(self.held, self.likelihood, self.evidence, Seen.of(beams), way, way, 1.0)


def test_a_rival_never_wins_on_one_scan_however_well_it_fits():
    made = Room(room(), ELSEWHERE)
    made.add(TRUTH)
    scans, winner = 0, None
    while winner is None and scans < 40:
        made.see(room(), TRUTH, way=5.0)
        winner, scans = made.hypotheses.challenge(PoseGaussian(made.held, NARROW)), scans + 1
    assert winner is not None
    assert scans >= PROVEN_SCANS
    assert winner.mean == pytest.approx(np.array(TRUTH), abs=0.05)
    assert len(made.hypotheses.rivals) == 1  # who was deposed may come back


def test_a_place_that_fitted_for_metres_is_believed_when_it_takes_over_and_the_one_given_up_is_not():
    """A robot that was put down wrong and finds itself need not drive metres more until anybody believes it."""
    made = Room(room(), ELSEWHERE)
    made.add(TRUTH)
    for _ in range(8):
        made.see(room(), TRUTH)
    before = made.hypotheses.fit.right
    assert made.hypotheses.challenge(PoseGaussian(made.held, NARROW)) is not None
    assert made.hypotheses.fit.right > 0.5 > made.hypotheses.rivals[0].fit.right == before


def test_a_place_that_never_fitted_is_not_believed_when_it_takes_over():
    made = Room(room(), ELSEWHERE)
    made.add((-1.0, 0.5, -1.5))
    for _ in range(8):
        made.see(room(), TRUTH)
    made.hypotheses.rivals[0].log_weight = made.hypotheses.held + 2.0 * LEAD  # where the one held fits worse still
    assert made.hypotheses.challenge(PoseGaussian(made.held, NARROW)) is not None
    assert made.hypotheses.fit.right < 0.1


def test_standing_still_proves_nothing():
    """The same scan again and again says what it said, not more."""
    made = Room(room(), ELSEWHERE)
    made.add(TRUTH)
    before = made.hypotheses.rivals[0].log_weight
    for _ in range(50):
        made.see(room(), TRUTH, way=0.0)
    assert made.hypotheses.rivals[0].log_weight == pytest.approx(before)
    assert made.hypotheses.challenge(PoseGaussian(made.held, NARROW)) is None


def test_the_second_lidar_tells_places_apart_too():
    """One lidar sees bare floor, the other the room: what it has to say must not be lost to the first's being first."""
    weights = {}
    for lidars in (("front",), ("front", "rear")):
        field = DistanceField(room(), 2.0)
        tracker, rng = HypothesisTracker(field, LocalizerParameters()), np.random.default_rng(1)
        tracker.hypotheses.add(np.array([TRUTH]), np.array([NARROW]), np.array(ELSEWHERE), -7.0)
        poses = PoseGaussian(np.array(ELSEWHERE), NARROW).sample(500, rng)
        beams = pick_beams(scan_at(room(), TRUTH, rng), IDENTITY, 1)
        for _ in range(4):
            for lidar in lidars:
                tracker.correct(poses, np.full(500, -6.0), beams, lidar, rng)
            tracker.predict(Pose2D(0.1, 0.0, 0.0), NARROW)
            tracker.hypotheses.rivals[0].belief = PoseGaussian(np.array(TRUTH), NARROW)  # it stands, all said and done
        weights[len(lidars)] = tracker.hypotheses.rivals[0].log_weight - tracker.hypotheses.held
    assert weights[2] > weights[1] + 0.3


def test_equal_evidence_gives_equal_weight():
    one = room().data
    twins = OccupancyMap(np.hstack((one, one)), 0.05, ORIGIN)
    made = Room(twins, TRUTH)
    beliefs = [PoseGaussian(np.array([TRUTH.x + dx, TRUTH.y, TRUTH.theta]), NARROW) for dx in (0.0, 8.0)]
    made.hypotheses.start(beliefs, np.zeros(2))
    for _ in range(10):
        made.see(room(), TRUTH)
    assert made.hypotheses.share_held == pytest.approx(0.5, abs=0.05)
    assert math.exp(made.hypotheses.rivals[0].log_weight) == pytest.approx(0.5, abs=0.05)


def in_one_of_two_rooms_alike(metres):
    """Return what is known after so many metres in the left one of two rooms alike; the right one came up at the start.
    """
    made = Room(OccupancyMap(np.hstack((room().data, room().data)), 0.05, ORIGIN), TRUTH)
    made.add(Pose2D(TRUTH.x + 8.0, TRUTH.y, TRUTH.theta))
    for _ in range(metres):
        made.see(room(), TRUTH)
    return made.hypotheses


def test_a_robot_that_fits_in_another_room_as_well_is_not_sure_of_either():
    """The evidence may be for the one by chance, since the map lacks a wall in the other: each alone would be sure."""
    hypotheses = in_one_of_two_rooms_alike(20)
    hypotheses.held, hypotheses.rivals[0].log_weight = 0.0, -12.0
    assert min(hypotheses.fit.right, hypotheses.rivals[0].fit.right) > 0.9
    assert 0.3 < hypotheses.reliability(0.05) < 0.6
    hypotheses.rivals = []
    assert hypotheses.reliability(0.05) > 0.9


def test_a_robot_is_as_sure_of_its_pose_after_a_turn_as_before_it():
    """A rival beside it, which told of the same place, spoke against it as soon as the robot had turned."""
    hypotheses = Hypotheses()
    hypotheses.add(np.array([[0.4, 0.0, 0.0]]), np.array([NARROW]), np.zeros(3))
    hypotheses.fit.right = hypotheses.rivals[0].fit.right = 0.9
    hypotheses.rivals[0].scans = 1
    before = hypotheses.reliability(0.05)
    hypotheses.predict(Pose2D(0.2, 0.0, 0.5), 1e-4 * np.eye(3), 0.45)
    assert hypotheses.reliability(0.05) == pytest.approx(before)


def test_a_place_where_scans_fit_is_not_forgotten_for_lack_of_weight():
    """It may be the right one, and nobody looks for it again while the other fits."""
    hypotheses = in_one_of_two_rooms_alike(5)
    hypotheses.rivals[0].log_weight = hypotheses.held - 40.0
    hypotheses.add(np.array([ELSEWHERE]), np.array([NARROW]), np.array(TRUTH))
    assert len(hypotheses.rivals) == 2
    hypotheses.rivals[0].fit.right = hypotheses.rivals[1].fit.right = 0.1
    hypotheses.add(np.array([ELSEWHERE]), np.array([NARROW]), np.array(TRUTH))
    assert len(hypotheses.rivals) == 1


def test_a_robot_put_down_wrong_is_found_although_its_scan_fits_in_sixty_places():
    """Each of them enters at small odds; all were given up at the next scan, the right one with them."""
    made = Room(room(), ELSEWHERE)
    others = [Pose2D(-2.0 + 0.4 * (i % 10), -1.5 + 0.5 * (i // 10), 2.5) for i in range(60)]
    places = np.array([TRUTH, *others])
    made.hypotheses.add(places, np.array([NARROW] * len(places)), made.held, -14.0)
    winner, scans = None, 0
    while winner is None and scans < 100:
        made.see(room(), TRUTH, way=0.05)
        winner, scans = made.hypotheses.challenge(PoseGaussian(made.held, NARROW)), scans + 1
    assert winner is not None
    assert winner.mean == pytest.approx(np.array(TRUTH), abs=0.05)


def test_a_pose_that_comes_right_by_itself_is_believed_as_the_rival_was_that_knew_the_place():
    """What spoke against it was seen elsewhere: a robot that slid back must not drive metres until anybody believes it.
    """
    made = Room(room(), ELSEWHERE)
    made.add(TRUTH)
    for _ in range(8):
        made.see(room(), TRUTH)
    assert made.hypotheses.reliability(0.05) < 0.1
    made.held = np.array(TRUTH)
    made.see(room(), TRUTH)
    assert not made.hypotheses.rivals
    assert made.hypotheses.reliability(0.05) > 0.5


def test_weights_sum_to_one_and_places_are_told_once():
    made = Room(room(), TRUTH)
    made.add(
        ELSEWHERE, Pose2D(ELSEWHERE.x + 0.05, ELSEWHERE.y, ELSEWHERE.theta), Pose2D(TRUTH.x + 0.1, TRUTH.y, TRUTH.theta)
    )
    assert len(made.hypotheses.rivals) == 1
    for _ in range(3):
        made.see(room(), TRUTH, way=0.3)
        total = made.hypotheses.share_held + sum(math.exp(rival.log_weight) for rival in made.hypotheses.rivals)
        assert total == pytest.approx(1.0)
    assert made.hypotheses.share_held > 0.9


def test_a_beam_through_a_wall_says_more_than_one_that_ends_on_nothing():
    """A person or a new rack is common, a wall that vanished is not."""
    wall = np.zeros((100, 200), dtype=np.int8)
    wall[:, 100] = 100
    evidence = Evidence(DistanceField(OccupancyMap(wall, 0.05, IDENTITY), 2.0), 0.2)
    ends = np.column_stack((np.full(20, 4.0), np.linspace(-0.5, 0.5, 20)))
    judged = evidence.judge(np.array([[0.4, 2.5, 0.0], [4.0, 2.5, 0.0]]), Seen(ends, ends[:0], 0.0, LASER))
    assert judged.through == pytest.approx([0.0, 1.0])
    assert judged.log_likelihoods[0] > judged.log_likelihoods[1] + 5.0


def test_what_the_map_lacks_is_learnt_over_metres_and_never_all():
    evidence = Evidence(DistanceField(room(), 2.0), 0.2)
    evidence.learn(0.0, 0.0)
    assert evidence.unmapped == 0.2
    for _ in range(1000):
        evidence.learn(0.5, 1.0)
    assert evidence.unmapped == pytest.approx(0.5, abs=0.01)
    for _ in range(1000):
        evidence.learn(0.0, 1.0)
    assert evidence.unmapped == pytest.approx(0.6)


def test_a_robot_whose_lidar_grazes_what_is_on_its_map_is_not_told_that_it_sees_through_walls():
    """A map of large cells: of the beams that hit as many cut a corner on their way as of those to a new rack."""
    data = np.zeros((100, 200), dtype=np.int8)
    data[:, 100:103] = 100
    data[48:50, 40:42] = 100  # a table's leg before the wall
    evidence = Evidence(DistanceField(OccupancyMap(data, 0.05, IDENTITY), 2.0), 0.2)
    pose, sides = np.array([[0.4, 2.45, 0.0]]), np.linspace(-1.5, 1.5, 20)
    to_wall = Seen(np.column_stack((np.full(20, 4.6), sides)), np.zeros((0, 2)), 0.0, LASER)
    to_rack = Seen(np.column_stack((np.full(20, 3.6), sides)), np.zeros((0, 2)), 0.0, LASER)
    judged = evidence.judge(pose, to_wall)
    assert 0.0 < judged.grazed[0] < 0.15 and judged.through[0] < 0.01
    before = evidence.judge(pose, to_rack).through[0]
    assert before > 0.05
    for _ in range(3):
        evidence.learn_grazing(judged, 0.2)
    assert evidence.judge(pose, to_rack).through[0] < 0.6 * before
    beyond = Seen(np.column_stack((np.full(20, 8.0), sides)), np.zeros((0, 2)), 0.0, LASER)
    assert evidence.judge(pose, beyond).through[0] > 0.8, "through the wall itself"


def test_no_more_beams_are_taken_to_graze_than_do_at_a_right_place():
    evidence = Evidence(DistanceField(room(), 2.0), 0.2)
    assert evidence.grazing == 0.0
    evidence.learn_grazing(Judgement(np.zeros(1), np.ones(1), np.zeros(1), np.full(1, 0.6)), 1.0)
    assert evidence.grazing == pytest.approx(0.075)


def test_where_two_rooms_look_alike_the_robot_says_so():
    one = room().data
    twins = OccupancyMap(np.hstack((one, one)), 0.05, ORIGIN)
    made = Localizer(LocalizerParameters(), twins, np.random.default_rng(1))
    made.globalize()
    estimate = made.process(IDENTITY, scan_at(room(), TRUTH), IDENTITY)
    assert estimate.weight < 0.6
    assert made.reliability() < 0.6
    assert math.sqrt(estimate.covariance[0, 0]) > 2.0
    (first, _), (second, _) = made.hypotheses()[:2]
    assert abs(first.x - second.x) == pytest.approx(8.0, abs=0.2)
    made.set_initial_pose(TRUTH, NARROW)
    assert made.process(IDENTITY, scan_at(room(), TRUTH), IDENTITY).weight > 0.9


def test_reliability_falls_at_a_wrong_pose_and_is_high_at_the_right_one():
    values = {}
    for name, believed in (("right", TRUTH), ("wrong", ELSEWHERE)):
        made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
        assert made.reliability() is None
        made.set_initial_pose(believed, NARROW)
        made.process(IDENTITY, scan_at(room(), TRUTH), IDENTITY)
        values[name] = made.reliability()
    assert values["right"] > 0.8
    assert values["wrong"] < 0.3


def test_a_robot_among_panes_claims_nothing():
    """Its lidar looks through them all: the map says that something should have come back."""
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(TRUTH, NARROW)
    made.process(IDENTITY, scan_at(room(), TRUTH), IDENTITY)
    assert made.reliability() > 0.8
    glass = LaserScan(np.full(180, np.inf), 0.0, 2.0 * math.pi / 180.0, 0.12, 6.0, 0.0)
    for index in range(1, 8):
        made.process(Pose2D(0.05 * index, 0.0, 0.0), glass, IDENTITY)
    assert made.reliability() < 0.1


def test_a_corridor_like_the_right_one_does_not_clear_a_wrong_pose():
    """Beams went through walls; what fits for a few metres afterwards fits there as well. Only a way of it clears."""
    fit = Reliability()
    fit.update(0.9, 0.0, 0.0)
    for _ in range(10):
        fit.update(0.5, 0.1, 0.2)
    for _ in range(15):
        fit.update(0.8, 0.0, 0.2)
    assert fit.right < 0.5
    for _ in range(100):
        fit.update(0.8, 0.0, 0.2)
    assert fit.right > 0.8


def test_looking_more_often_neither_clears_nor_condemns_a_pose():
    told = []
    for step in (0.05, 0.2, 1.0):
        fit = Reliability()
        fit.update(0.8, 0.0, 0.0)
        for _ in range(round(10.0 / step)):
            fit.update(0.6, 0.01, step)
        told.append(fit.right)
    assert told == pytest.approx([told[0]] * 3, abs=0.03)


def test_after_a_jump_of_odometry_a_wrong_pose_is_no_more_than_not_known():
    fit = Reliability()
    for _ in range(10):
        fit.update(0.2, 0.3, 0.5)
    fit.update(0.2, 0.0, 1e9)
    assert fit.right < 0.65


def test_a_wall_that_should_be_there_and_is_not_speaks_against_a_place():
    """All that comes back fits both places; of one the map has a wall in a direction where nothing came back."""
    data = np.zeros((100, 400), dtype=np.int8)
    data[:3] = 100
    data[:, 260:263] = 100
    evidence = Evidence(DistanceField(OccupancyMap(data, 0.05, IDENTITY), 2.0), 0.2)
    ends = np.column_stack((np.linspace(-0.5, 0.5, 20), np.full(20, -0.9)))
    passed = np.column_stack((np.full(20, 3.0), np.linspace(0.0, 1.0, 20)))
    judged = evidence.judge(np.array([[3.0, 1.0, 0.0], [11.5, 1.0, 0.0]]), Seen(ends, passed, 0.5, LASER))
    assert judged.hits[0] == pytest.approx(judged.hits[1])
    assert judged.through == pytest.approx([0.0, 0.5])
    assert judged.log_likelihoods[0] > judged.log_likelihoods[1] + 3.0


def test_a_lidar_that_fails_at_single_beams_sees_through_no_wall():
    scan = scan_at(room(), TRUTH)
    scan.ranges[::3] = np.inf
    assert not pick_beams(scan, IDENTITY, 1).silent.any()
    scan.ranges[10:20] = np.inf
    assert np.count_nonzero(pick_beams(scan, IDENTITY, 1).silent) >= 8
    scan.ranges[:] = 0.0
    assert not pick_beams(scan, IDENTITY, 1).silent.any()


@pytest.mark.parametrize("word", [np.inf, 6.0, 100.0])
def test_walls_that_should_be_there_are_missed_whatever_a_lidar_s_word_for_nothing(word):
    """Where it is range_max itself, as with many drivers, no place was ever doubted for what it did not show."""
    scan = scan_at(room(), TRUTH)
    scan.ranges[10:20] = word
    assert scan.range_max == 6.0 and pick_beams(scan, IDENTITY, 1).silent.tolist() == [
        10 < beam < 19 for beam in range(len(scan.ranges))]


def test_a_robot_that_has_seen_nothing_yet_is_neither_right_nor_wrong():
    """In the middle of a hall no beam comes back: the pose it was told is no worse for that, but wears off."""
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(TRUTH, NARROW)
    nothing = LaserScan(np.full(180, np.inf), 0.0, 2.0 * math.pi / 180.0, 0.12, 0.8, 0.0)
    told = []
    for index in range(8):
        made.process(Pose2D(float(index), 0.0, 0.0), nothing, IDENTITY)
        told.append(made.reliability())
    assert told[0] == pytest.approx(0.5, abs=0.01)
    assert told[-1] < 0.4
