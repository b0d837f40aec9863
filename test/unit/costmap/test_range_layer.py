"""What sonars measure becomes obstacles, and ways that are free, in a costmap."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.range_layer import RangeSensorLayer
from mbf_relay.geometry import IDENTITY, Pose2D

TOPIC, CONE, STEP = "/sonar", 0.5, 0.05
PLACES = [Pose2D(0.0, 0.0, 0.0), Pose2D(0.31, -0.17, 2.9), Pose2D(-0.4, 0.2, -1.2)]


def costmap_with(rolling=False, **layer):
    """As public robots have it in their files."""
    return build_costmap("local_costmap", {
        "global_frame": "odom", "width": 6.0, "height": 6.0, "resolution": STEP, "origin_x": -3.0, "origin_y": -3.0,
        "robot_radius": 0.1, "rolling_window": rolling, "track_unknown_space": True,
        "plugins": [{"name": "sonar", "type": "range_sensor_layer::RangeSensorLayer"}],
        "sonar": {"topics": [TOPIC], **layer},
    })


def hear(costmap, distance, sensor=PLACES[0], hit=True, now=1.0, cone=CONE, robot=IDENTITY):
    angles = 0.5 * cone * np.array([-1.0, 0.0, 1.0])
    ends = sensor.transform_points(distance * np.column_stack((np.cos(angles), np.sin(angles))))
    costmap.observe(TOPIC, Observation((sensor.x, sensor.y), ends, np.full(3, hit), now, heading=sensor.theta), now)
    costmap.update(now, robot)


def cost(costmap, x, y):
    grid = costmap.snapshot()
    column, row = grid.grid.cell_at(x, y)
    return int(grid.costs[row, column])


def reference(distance, phi, away, aside, half, band):
    """The sensor's model as the C++ layer has it, cell by cell."""
    weight = (1.0 - (1.0 + math.tanh(2.0 * (away - phi))) / 2.0) * (1.0 - (aside / half) ** 2)
    if away < distance - 2.0 * band:
        return 0.5 * (1.0 - weight)
    if away < distance - band:
        return weight * 0.5 * ((away - (distance - 2.0 * band)) / band) ** 2 + 0.5 * (1.0 - weight)
    if away < distance + band:
        return weight * (0.5 - 0.5 * ((distance - away) / band) ** 2) + 0.5
    return 0.5


@pytest.mark.parametrize("sensor", PLACES)
def test_a_robot_sees_by_its_sonar_what_is_before_it(sensor):
    costmap = costmap_with()
    hear(costmap, 0.8, sensor)
    ahead = [sensor.transform_points(np.array([[x, 0.0]]))[0] for x in (0.3, 0.5, 0.8, 1.2)]
    assert [cost(costmap, *point) for point in ahead[:3]] == [FREE_SPACE, FREE_SPACE, LETHAL]
    assert cost(costmap, *ahead[3]) not in (FREE_SPACE, LETHAL), "what lies behind nobody knows"
    beside = sensor.transform_points(0.8 * np.array([[math.cos(0.6 * CONE), math.sin(0.6 * CONE)]]))[0]
    assert cost(costmap, *beside) not in (FREE_SPACE, LETHAL)


@pytest.mark.parametrize("seed", range(5))
def test_cells_become_as_likely_as_by_the_c_layer_s_model(seed):
    chance = np.random.default_rng(seed)
    costmap = costmap_with(phi=chance.uniform(0.8, 2.0))
    layer = costmap.layers[0]
    assert isinstance(layer, RangeSensorLayer)
    expected = np.full(layer.grid.shape, 0.5)
    for _ in range(4):
        sensor = Pose2D(*chance.uniform((-1.0, -1.0, -3.1), (1.0, 1.0, 3.1)))
        distance, cone = chance.uniform(0.2, 1.5), chance.uniform(0.1, 1.0)
        hear(costmap, distance, sensor, cone=cone)
        band = STEP * max(distance, 1.0)
        for row in range(layer.grid.height):
            for column in range(layer.grid.width):
                x, y = -3.0 + (column + 0.5) * STEP - sensor.x, -3.0 + (row + 0.5) * STEP - sensor.y
                aside = abs(math.remainder(math.atan2(y, x) - sensor.theta, 2.0 * math.pi))
                if aside <= 0.5 * cone:
                    said = reference(distance, layer.parameters.phi, math.hypot(x, y), aside, 0.5 * cone, band)
                    before = expected[row, column]
                    after = said * before / (said * before + (1.0 - said) * (1.0 - before))
                    expected[row, column] = min(max(after, 0.05), 0.95)
    np.testing.assert_allclose(layer._probability, expected, atol=2e-3)


def test_what_is_gone_is_free_again_after_some_readings_and_what_came_is_marked_though_it_was_free_for_long():
    costmap = costmap_with()
    for _ in range(20):
        hear(costmap, 0.6)
    for _ in range(5):
        hear(costmap, 1.4)
    assert cost(costmap, 0.6, 0.0) == FREE_SPACE
    for _ in range(3):
        hear(costmap, 0.6)
    assert cost(costmap, 0.6, 0.0) == LETHAL


@pytest.mark.parametrize("clears", [True, False])
def test_a_reading_of_nothing_frees_the_cone_where_asked(clears):
    costmap = costmap_with(clear_on_max_reading=clears)
    assert costmap.sources[TOPIC].inf_is_valid is clears
    assert bool(costmap.layers[0].notice) is not clears, "told where the C++ layer does otherwise"
    hear(costmap, 0.6)
    for _ in range(3):
        hear(costmap, 2.0, hit=False)
    assert cost(costmap, 0.6, 0.0) == FREE_SPACE and cost(costmap, 1.9, 0.0) == FREE_SPACE


@pytest.mark.parametrize("hit", [True, False])
def test_a_reading_of_astronomical_size_costs_no_time_and_draws_nothing(hit):
    costmap = costmap_with(clear_on_max_reading=True)
    for distance in (0.0, 11.0, 1e30):
        hear(costmap, distance, hit=hit)
    assert not (costmap.layers[0].costs == LETHAL).any() and cost(costmap, -1.0, 0.0) != FREE_SPACE
    assert (cost(costmap, 2.5, 0.0) == FREE_SPACE) is not hit


def test_a_layer_that_is_switched_off_does_not_gather_readings_for_days():
    costmap = costmap_with(enabled=False)
    for count in range(1000):
        hear(costmap, 0.8, now=1.0 + 0.1 * count)
    assert len(costmap.layers[0]._readings) <= 100


def test_a_cone_may_be_looked_at_in_part():
    costmap = costmap_with(inflate_cone=0.2)
    hear(costmap, 0.8)
    inside, outside = (0.8 * math.cos(angle) for angle in (0.0, 0.15)), 0.8 * math.sin(0.15)
    assert cost(costmap, next(inside), 0.0) == LETHAL and cost(costmap, next(inside), outside) != LETHAL


def test_a_robot_whose_sonar_falls_silent_stands_where_that_is_asked_for():
    costmap = costmap_with(no_readings_timeout=0.5)
    costmap.update(1.0, IDENTITY)
    assert "'/sonar': no reading has come" in costmap.stale_reason(1.0)
    hear(costmap, 0.8, now=1.0)
    assert costmap.stale_reason(1.4) is None
    costmap.refuse(TOPIC, "message refused: its range is not a number (NaN)", is_blind=False)
    costmap.update(1.6, IDENTITY)
    assert "no reading for 0.60 s; at most 0.50 s allowed (no_readings_timeout); message refused" in (
        costmap.stale_reason(1.6))
    assert "no reading for 100.00 s" in costmap.layers[0].stale_reason(-99.0), "time was set back"
    hear(costmap, 0.8, now=1.7)
    costmap.update(2.3, IDENTITY)
    assert costmap.stale_reason(2.3).endswith("at most 0.50 s allowed (no_readings_timeout)"), "it was used since"


def test_what_a_sonar_saw_stays_where_it_is_while_the_window_rolls_and_is_forgotten_when_cleared():
    costmap, robot = costmap_with(rolling=True), Pose2D(0.5, 0.3, 0.4)
    hear(costmap, 0.8)
    costmap.update(1.1, robot)
    assert cost(costmap, 0.8, 0.0) == LETHAL
    hear(costmap, 1.2, Pose2D(0.0, 0.0, 0.6), now=1.15, robot=robot)
    assert cost(costmap, 0.8, 0.0) == LETHAL, "a look past it moved it along with the robot"
    costmap.clear(around=Pose2D(0.8, 0.0, 0.0), side=0.5, inside=False)
    costmap.update(1.2, robot)
    assert cost(costmap, 0.8, 0.0) == LETHAL
    costmap.clear(around=robot, side=0.3, inside=False)
    costmap.update(1.25, robot)
    assert cost(costmap, 0.8, 0.0) != LETHAL
    hear(costmap, 0.8, now=1.3, robot=robot)
    costmap.clear()
    costmap.update(1.4, robot)
    assert cost(costmap, 0.8, 0.0) != LETHAL


def test_a_robot_whose_sonar_has_nothing_to_say_drives_where_nothing_else_is_asked_for():
    costmap = costmap_with()
    costmap.update(1.0, IDENTITY)
    assert costmap.stale_reason(1.0) is None
    hear(costmap, 0.8)
    costmap.observe(TOPIC, Observation((0.0, 0.0), np.zeros((0, 2)), np.zeros(0, bool), 1.1), 1.1)
    costmap.update(1.1, IDENTITY)
    assert costmap.stale_reason(1.1) is None and cost(costmap, 0.8, 0.0) == LETHAL


def test_a_layer_whose_numbers_contradict_each_other_or_that_hears_nothing_is_named():
    with pytest.raises(ValueError, match="mark_threshold is 0.1; it must not be below clear_threshold, 0.2"):
        costmap_with(mark_threshold=0.1)
    assert any("topics is empty" in note for note in costmap_with(topics=[]).notes)


@pytest.mark.parametrize("ns, topic, listens_to", [
    ("/robot", "/left", "/robot/left"), ("/robot", "left", "/robot/left"),
    ("/robot/", "sonar/left", "/robot/sonar/left"),
    ("robot/sonar", "left", "robot/sonar/left"), ("/", "left", "/left"), ("", "left", "left"), ("", "/left", "/left"),
])
def test_topics_are_below_the_layer_s_namespace_with_one_slash_between(ns, topic, listens_to):
    source = costmap_with(ns=ns, topics=[topic]).sources[listens_to]
    assert source.topic == listens_to


def test_without_topics_the_layer_listens_to_the_one_that_upstream_s_does():
    costmap = build_costmap("local_costmap", {
        "robot_radius": 0.1, "plugins": [{"name": "sonar", "type": "range_sensor_layer::RangeSensorLayer"}]})
    assert list(costmap.sources) == ["/sonar"] and not any("topics" in note for note in costmap.notes)


def test_a_sonar_in_an_obstacle_layer_is_refused_by_where_it_belongs():
    with pytest.raises(ValueError, match="'sonar': its data_type is Range, which range_sensor_layer::RangeSensorLayer"):
        build_costmap("local_costmap", {
            "plugins": [{"name": "obstacles", "type": "costmap_2d::ObstacleLayer"}],
            "obstacles": {"observation_sources": "sonar", "sonar": {"data_type": "Range"}}})
