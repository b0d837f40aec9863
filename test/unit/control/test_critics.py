"""Each critic against a plain reference on random scenes."""

import math

import numpy as np
import pytest
from paper import burger, random_scene

from mbf_relay.control.critics import CRITICS
from mbf_relay.control.critics.critic import RULED_OUT, Critic
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.plugins import find_class

SEEDS = range(6)
NEAR_SEEDS = (342, 579, 664, 943)
"""Of scenes with an obstacle so near that the robot cannot stop on some trajectories."""


def critic(name, **changes):
    return find_class(name, Critic, CRITICS)(name, burger(**changes))


def place_on_path(path, x, y, start, end):
    """Distance across and arc length along, by looking at points 0.1 mm apart."""
    arcs = np.arange(max(path.arcs[0], start - 0.03), min(path.arcs[-1], end + 0.03), 1e-4)
    places = np.column_stack(
        (np.interp(arcs, path.arcs, path.points[:, 0]), np.interp(arcs, path.arcs, path.points[:, 1]))
    )
    gaps = np.hypot(places[:, 0] - x, places[:, 1] - y)
    return gaps.min(), arcs[gaps <= gaps.min() + 2e-4]


@pytest.mark.parametrize("name, shift", [("path", 0.0), ("goal", 0.0), ("alignment", 0.325), ("goal_front", 0.325)])
@pytest.mark.parametrize("seed", SEEDS)
def test_places_are_measured_along_and_across_the_path(name, shift, seed):
    rng = np.random.default_rng(seed)
    batch, data = random_scene(rng)
    scores = critic(name).score(batch, data)
    arc, reach = data.path.robot_arc, 0.22 * 1.5 + shift
    for n in rng.integers(0, len(batch), 40):
        x, y, theta = batch.ends[n]
        x, y = x + shift * math.cos(theta), y + shift * math.sin(theta)
        across, along = place_on_path(data.path, x, y, arc - 1.3 * 0.21 - shift, arc + reach + 0.9 * 0.21)
        if name in ("path", "alignment"):
            assert scores[n] == pytest.approx(across, abs=2e-3)
        else:
            left = arc + reach + 0.9 * 0.21 - along - batch.spare[n]
            assert np.abs(scores[n] - np.maximum(0.0, left)).min() < 0.03


def test_the_forward_point_is_not_held_to_the_path_near_the_goal():
    batch, data = random_scene(np.random.default_rng(1))
    near = data.__class__(**{**vars(data), "pose": Pose2D(data.path.goal.x + 0.3, data.path.goal.y, 0.0)})
    far = data.__class__(**{**vars(data), "pose": Pose2D(data.path.goal.x + 0.4, data.path.goal.y, 0.0)})
    assert not critic("alignment").score(batch, near).any()
    assert critic("alignment").score(batch, far).any()
    assert critic("alignment", cheat_factor=0.5).score(batch, near).any()


def test_the_forward_point_falls_silent_little_by_little():
    batch, data = random_scene(np.random.default_rng(1))

    def scores(distance):
        pose = Pose2D(data.path.goal.x + distance, data.path.goal.y, 0.0)
        return critic("alignment").score(batch, data.__class__(**{**vars(data), "pose": pose}))

    full = scores(2.0)
    assert scores(0.66) == pytest.approx(full)
    assert scores(0.325 * 1.5) == pytest.approx(0.5 * full)
    assert scores(0.326).max() < 0.01 * full.max()


@pytest.mark.parametrize("name", ["alignment", "goal_front"])
def test_without_a_nose_its_critics_are_silent(name):
    batch, data = random_scene(np.random.default_rng(1))
    assert not critic(name, forward_point_distance=0.0).score(batch, data).any()


@pytest.mark.parametrize("sums", [False, True])
@pytest.mark.parametrize("seed", [*SEEDS, *NEAR_SEEDS])
def test_the_obstacle_critic_charges_what_is_passed_and_rules_out_what_cannot_stop(sums, seed):
    batch, data = random_scene(np.random.default_rng(seed))
    scores = critic("obstacle", sum_scores=sums).score(batch, data)
    for n in range(len(batch)):
        v = batch.velocities[n]
        stopping = 0.1 + 0.2 + max(abs(v[0]) / (2 * 2.5), abs(v[2]) / (2 * 3.2))
        cells = data.checker.costmap.grid.cells_at(batch.poses[n, : batch.free[n]])
        costs = data.checker.costmap.costs[cells[:, 1], cells[:, 0]].astype(float)
        expected = costs.sum() if sums else costs.max(initial=0.0)
        touches = batch.free[n] < batch.counts[n]
        if touches and batch.free[n] * batch.steps[n] < stopping:
            assert np.isinf(scores[n])
        else:
            assert scores[n] == pytest.approx(max(expected, 253.0) if touches else expected)
    assert np.isinf(scores).any() == (seed in NEAR_SEEDS)


def test_safety_has_no_switch():
    assert critic("obstacle", occdist_scale=0.0).scale > 0.0


def test_motion_is_charged_as_documented():
    batch, data = random_scene(np.random.default_rng(4), velocity=Twist2D(0.0, 0.0, 0.3))
    v = batch.velocities
    assert critic("twirling", twirling_scale=2.0).score(batch, data) == pytest.approx(np.abs(v[:, 2]))
    assert critic("prefer_forward").score(batch, data) == pytest.approx(np.clip(-v[:, 0] / 0.22, 0.0, None))
    assert critic("steady").score(batch, data) == pytest.approx(np.abs(v[:, 2] - 0.3))
    creeps = (np.abs(v[:, 0]) > 0.01) & (np.abs(v[:, 0]) < 0.11 - 1e-4) & (np.abs(v[:, 2]) < 1.37 - 1e-4)
    assert critic("slow").score(batch, data).tolist() == creeps.astype(float).tolist()


def test_weights_come_from_the_parameters():
    weights = dict(path="path_distance_bias", alignment="path_distance_bias", goal="goal_distance_bias",
                   goal_front="goal_distance_bias", obstacle="occdist_scale", twirling="twirling_scale")
    for name, parameter in weights.items():
        assert critic(name, **{parameter: 7.5}).scale == 7.5
    for name, parameter in dict(
        prefer_forward="prefer_forward_scale", slow="slow_scale", steady="steady_scale",
        counter_steering="counter_steering_scale"
    ).items():
        assert critic(name, **{parameter: 0.5, "path_distance_bias": 10.0}).scale == 5.0


class TestCounterSteering:
    def scores(self, *turns):
        """Return scores and turns of a batch after these turns were driven."""
        batch, data = random_scene(np.random.default_rng(4), velocity=Twist2D(0.1, 0.0, 0.0))
        counter = critic("counter_steering")
        for turn in turns:
            counter.driven(Twist2D(0.2, 0.0, turn), data)
        return counter.score(batch, data), batch.velocities[:, 2], data.horizon_scale

    def test_a_robot_that_has_not_turned_may_turn_either_way(self):
        assert not self.scores()[0].any()

    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_to_turn_to_the_other_side_is_charged_and_to_go_on_is_not(self, side):
        scores, turns, whole = self.scores(side * 0.3)
        assert not scores[side * turns >= 0.0].any()
        assert (scores[side * turns < 0.0] > 0.0).all()
        assert (side * turns < -0.12).any() and scores[side * turns < -0.12] == pytest.approx(whole)

    def test_once_turned_the_other_side_is_the_charged_one(self):
        assert self.scores(0.3, -0.3)[0] == pytest.approx(self.scores(-0.3)[0])

    def test_going_nearly_straight_changes_no_side(self):
        assert self.scores(0.3, -0.03)[0] == pytest.approx(self.scores(0.3)[0])


class TestOscillation:
    def scene_at(self, x=0.0, theta=0.0):
        _, data = random_scene(np.random.default_rng(1))
        return data.__class__(**{**vars(data), "pose": Pose2D(x, 0.0, theta)})

    def banned(self, oscillation, **velocity):
        batch, data = random_scene(np.random.default_rng(1), velocity=Twist2D(0.0, 0.0, 0.0))
        scores = oscillation.score(batch, data)
        assert set(scores.tolist()) <= {0.0, RULED_OUT}
        component, sign = next(iter(velocity.items()))
        values = batch.velocities[:, ("x", "y", "theta").index(component)] * sign
        return bool(np.isinf(scores[values > 1e-9]).all()), bool(np.isinf(scores[values < -1e-9]).all())

    def test_one_reversal_bans_the_next(self):
        oscillation = critic("oscillation")
        oscillation.driven(Twist2D(0.2, 0.0, 0.0), self.scene_at())
        assert self.banned(oscillation, x=1.0) == (False, False)
        oscillation.driven(Twist2D(-0.2, 0.0, 0.0), self.scene_at())
        assert self.banned(oscillation, x=1.0) == (True, False)
        assert oscillation.bans == {"x": -1}

    def test_turning_counts_only_on_the_spot(self):
        oscillation = critic("oscillation")
        for turn in (0.5, -0.5):
            oscillation.driven(Twist2D(0.2, 0.0, turn), self.scene_at())
        assert not oscillation.bans
        for turn in (0.5, -0.5):
            oscillation.driven(Twist2D(0.0, 0.0, turn), self.scene_at())
        assert oscillation.bans == {"theta": -1}

    @pytest.mark.parametrize(
        "x, theta, lifted", [(0.04, 0.0, False), (0.06, 0.0, True), (0.0, 0.15, False), (0.0, 0.25, True)]
    )
    def test_getting_somewhere_lifts_the_ban(self, x, theta, lifted):
        oscillation = critic("oscillation")
        for speed in (0.2, -0.2):
            oscillation.driven(Twist2D(speed, 0.0, 0.0), self.scene_at())
        oscillation.driven(Twist2D(-0.2, 0.0, 0.0), self.scene_at(x, theta))
        assert (not oscillation.bans) is lifted
        oscillation.reset()
        assert not oscillation.bans
