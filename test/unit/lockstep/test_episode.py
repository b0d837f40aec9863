"""Whole drives: they succeed, repeat to the last bit, and end with a reason where they fail."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

pytest.importorskip("pybullet")
sys.path.insert(0, str(Path(__file__).parent))

import own_critics  # noqa: E402
import small_worlds  # noqa: E402
from driven import bent_by_odometry, circle_by_amcl  # noqa: E402

from mbf_relay.control.dwa_parameters import DwaParameters  # noqa: E402
from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.episodes import EpisodeJob, drive  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import SERVER, make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import circle, load_tasks, task_of  # noqa: E402
from mbf_relay.lockstep.workers import run  # noqa: E402
from mbf_relay.simulation.generators import generate  # noqa: E402
from mbf_relay.simulation.worlds_file import world_of  # noqa: E402
from mbf_relay.tracking.tracker import Tracker  # noqa: E402

BLIND = make_setup(config_folder(), has_map=False)
SEEING = make_setup(config_folder())


def task(tmp_path, world):
    return load_tasks(small_worlds.write(tmp_path / "worlds.json", world))[0]


def with_controller(setup, name):
    server = {**setup.settings[SERVER], "controllers": [{"name": "own", "type": f"small_worlds.{name}"}]}
    return dataclasses.replace(setup, settings={**setup.settings, SERVER: server})


def test_the_circle_is_driven_by_amcl():
    result = circle_by_amcl()
    assert result.success, (result.outcome, result.message)
    assert result.goals_reached == 8 and result.contacts == 0
    assert 50.0 < result.time < 90.0 and 11.0 < result.path_length < 14.0
    assert result.smallest_clearance > 0.05
    assert 0.0 < result.localization_error_mean < 0.1
    assert list(result.goal_times) == sorted(result.goal_times) and result.goal_times[-1] == result.time
    assert len(result.goal_waits) == 8 and 0.0 < sum(result.goal_waits) / 8 < 0.6, (
        "it does not dawdle where it has arrived"
    )


def test_a_robot_whose_global_costmap_is_hardly_ever_updated_drives_at_once(tmp_path):
    """Racing cars' files have 0.001 Hz, which C++'s begins with when there is a pose; here it was 1000 s later."""
    seldom = make_setup(config_folder(), changes=["move_base_flex.global_costmap.update_frequency=0.001"])
    result = Episode(task(tmp_path, small_worlds.FREE), seldom, seed=1).run()
    assert result.success, (result.outcome, result.message)


def test_of_a_controller_that_gives_no_number_the_result_says_so(tmp_path):
    """All of a night's drives had timed out, and no line said why the robot had stood."""
    short = task(tmp_path, {**small_worlds.FREE, "time_limit": 3.0})
    result = Episode(short, with_controller(BLIND, "Undecided"), seed=1).run()
    assert result.outcome == "TIMEOUT" and result.message == (
        "goal 1 of 1 not reached in time; the controller last said NO_VALID_CMD: controller 'own' returned velocity "
        "(nan, 0.0, 0.0), which no robot drives")


@pytest.mark.parametrize("controller", ["DWAPlannerROS", "PurePursuit", "MPPI"])
def test_a_robot_that_navigates_in_utm_arrives(tmp_path, controller):
    """Its goals and plans were taken, and its controller held the path to be farther away than anything driven to."""
    setup = make_setup(config_folder(), has_map=False, controller=controller)
    result = Episode(task(tmp_path, small_worlds.moved(small_worlds.BENT, 500000.1, 4500000.2)), setup, seed=1).run()
    assert result.success and result.contacts == 0, (result.outcome, result.message)


def test_a_plugin_that_draws_from_global_generators_drives_alike_by_seed_whatever_was_driven_before(tmp_path):
    short, setup = task(tmp_path, small_worlds.FREE), with_controller(BLIND, "Trembling")
    whole = [Episode(short, setup, seed).run().digest for seed in (1, 2)]
    assert Episode(short, setup, seed=2).run().digest == whole[1] != whole[0]


def test_the_built_in_critics_drive_the_circle_alike_under_a_users_own_names():
    server = SEEING.settings[SERVER]
    dwa = {**server["DWAPlannerROS"], "critics": [own_critics.path_of(name) for name in DwaParameters().critics]}
    own = dataclasses.replace(SEEING, settings={**SEEING.settings, SERVER: {**server, "DWAPlannerROS": dwa}})
    beginning = dataclasses.replace(circle(), goals=circle().goals[:3])
    built_in, named = circle_by_amcl(), Episode(beginning, own, seed=1).run()
    assert built_in.success and named.success
    rows = len(named.trajectory) - 1  # the last is of the moment it ends
    assert np.array_equal(built_in.trajectory[:rows], named.trajectory[:rows]) and rows > 200


def test_a_world_without_a_map_is_crossed_on_odometry():
    result = bent_by_odometry()
    assert result.success, (result.outcome, result.message)
    assert result.score == 0.5
    assert result.smallest_clearance > 0.0
    assert result.final_error <= 0.3


def test_a_robot_whose_files_name_frames_as_tf_did_drives_alike(tmp_path):
    server = dict(BLIND.settings[SERVER], global_frame="/map", robot_frame="/base_footprint")
    for name, frame in (("global_costmap", "/map"), ("local_costmap", "/odom")):
        server[name] = {**server[name], "global_frame": frame, "robot_base_frame": "/base_footprint"}
    old = dataclasses.replace(BLIND, settings={**BLIND.settings, SERVER: server})
    result = Episode(task(tmp_path, small_worlds.BENT), old, seed=1).run()
    assert result.success, result.message
    assert np.array_equal(bent_by_odometry().trajectory, result.trajectory)


def test_a_robot_whose_odometry_has_a_frame_of_another_name_sees_its_scans(tmp_path):
    """No scan came to its costmaps, and it was said that the lidar sends none."""
    server = dict(BLIND.settings[SERVER])
    server["local_costmap"] = {**server["local_costmap"], "global_frame": "odom_combined"}
    amcl = {**BLIND.settings["amcl"], "odom_frame_id": "odom_combined"}
    other = dataclasses.replace(BLIND, settings={**BLIND.settings, SERVER: server, "amcl": amcl})
    result = Episode(task(tmp_path, small_worlds.BENT), other, seed=1).run()
    assert result.success, result.message
    assert np.array_equal(bent_by_odometry().trajectory, result.trajectory)


def test_a_costmap_in_a_frame_that_nobody_broadcasts_is_named(tmp_path):
    server = dict(BLIND.settings[SERVER])
    server["local_costmap"] = {**server["local_costmap"], "global_frame": "odom_combined"}
    lost = dataclasses.replace(BLIND, settings={**BLIND.settings, SERVER: server})
    result = Episode(task(tmp_path, small_worlds.BENT), lost, seed=1).run()
    assert not result.success and "local_costmap" in result.message and "odom_combined" in result.message


def test_a_drive_is_not_charged_with_memory_that_is_long_given_back(tmp_path):
    np.ones(25_000_000)  # 190 MiB, and free again
    told = Episode(task(tmp_path, small_worlds.BENT), BLIND, 1).run().machine["memory_mib"]
    assert told == pytest.approx(psutil.Process().memory_info().rss / 2**20, abs=100.0)


def test_equal_seeds_give_equal_drives_and_other_seeds_other_ones(tmp_path):
    made = task(tmp_path, small_worlds.BENT)
    first, second, other = (Episode(made, BLIND, seed).run() for seed in (4, 4, 5))
    assert first.drive() == second.drive()
    assert first.digest != other.digest


def test_a_drive_does_not_depend_on_where_its_memory_lies():
    made = dataclasses.replace(circle(), goals=circle().goals[:1])
    digests, ballast = set(), []
    for size in (0, 1000, 37, 5000):
        ballast += [np.empty(size + 8 * k) for k in range(20)]
        digests.add(Episode(made, SEEING, 1).run().digest)
    assert len(digests) == 1


def test_a_drive_does_not_depend_on_how_many_processes_there_are(tmp_path):
    worlds = load_tasks(small_worlds.write(tmp_path / "worlds.json", small_worlds.BENT, small_worlds.FREE))
    jobs = [EpisodeJob(worlds[0], BLIND, 1), EpisodeJob(worlds[1], BLIND, 1), EpisodeJob(worlds[0], BLIND, 2)]
    one, two = (run(jobs, processes) for processes in (1, 2))
    assert [result.drive() for result in one] == [result.drive() for result in two]
    assert one[1].drive() == drive(jobs[1]).drive()


def test_two_setups_in_one_world_have_each_their_own_result(tmp_path):
    made = task(tmp_path, small_worlds.FREE)
    jobs = [EpisodeJob(made, dataclasses.replace(BLIND, controller=name), 1) for name in ("", "PurePursuit")]
    assert [result.digest for result in run(jobs, 1)] == [drive(job).digest for job in jobs]


def test_truth_has_no_error_and_amcl_finds_its_way_in_a_drawn_map(tmp_path):
    made = task(tmp_path, small_worlds.BENT)
    truth = Episode(made, make_setup(config_folder(), "truth", "known"), 1).run()
    assert truth.success and truth.localization_error_max < 2e-3
    amcl = Episode(made, make_setup(config_folder(), "amcl", "known"), 1).run()
    assert amcl.success and 0.0 < amcl.localization_error_mean < 0.15


def test_a_map_in_the_rolling_costmap_stands_where_it_is_for_a_robot_that_starts_elsewhere_than_at_its_origin(tmp_path):
    layers = [(name, f"costmap_2d::{name}", {}) for name in ("StaticLayer", "InflationLayer")]
    server = dict(SEEING.settings[SERVER])
    server["local_costmap"] = {
        **server["local_costmap"], "plugins": [{"name": name, "type": kind} for name, kind, _values in layers]}
    mapped = dataclasses.replace(
        SEEING, settings={**SEEING.settings, SERVER: server}, localization="truth", map="known")
    past = {**small_worlds.FREE, "cylinders": [[0.8, 0.0, 0.3, 0.5]], "start": [2.0, 1.0, 0.0], "goal": [3.6, 1.0, 0.0]}
    result = Episode(task(tmp_path, past), mapped, seed=1).run()
    assert result.success and result.path_length < 1.65, (result.outcome, result.message)  # straight on


def test_a_start_inside_of_something_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match="start.*lies in 'blocked_start_0'; choose a free place"):
        Episode(task(tmp_path, small_worlds.BLOCKED_START), BLIND, 1)


def test_time_runs_out_or_navigation_gives_up_where_there_is_no_way(tmp_path):
    result = Episode(task(tmp_path, small_worlds.WALLED_IN), BLIND, 1).run()
    assert not result.success and result.score == 0.0
    assert result.contacts == 0 and result.smallest_clearance > 0.0
    assert (
        result.outcome == "TIMEOUT" and "goal 1 of 1" in result.message and result.time == pytest.approx(4.0, abs=0.2)
    )


def test_a_goal_that_something_stands_on_is_reached_as_far_as_its_radius_allows(tmp_path):
    on_it = {**small_worlds.FREE, "cylinders": [[1.6, 0.1, 0.05, 0.5]]}
    assert Episode(task(tmp_path, on_it), BLIND, 1).run().success
    exact = Episode(task(tmp_path, {**on_it, "goal_radius": 0.02, "time_limit": 60.0}), BLIND, 1).run()
    assert not exact.success
    assert "(1.600, 0.100) lies" in exact.message and "obstacle" in exact.message  # in it or by it, as scans mark it


@pytest.mark.parametrize("localization, times", [("odometry", 1), ("truth", 2)])
def test_a_scan_is_looked_through_once_where_the_costmaps_lie_still_to_each_other(
    tmp_path, monkeypatch, localization, times
):
    stamps, update = [], Tracker.update

    def noted(tracker, x, y, ends, hits, stamp, heading):
        stamps.append(stamp)
        update(tracker, x, y, ends, hits, stamp, heading)

    monkeypatch.setattr(Tracker, "update", noted)
    setup = make_setup(config_folder(), localization, has_map=False)
    assert Episode(task(tmp_path, small_worlds.FREE), setup, seed=1).run().success
    assert len(stamps) == times * len(set(stamps)) > 20


def test_a_mover_that_runs_into_the_robot_is_a_contact(tmp_path):
    result = Episode(task(tmp_path, small_worlds.RUN_OVER), BLIND, 1).run()
    assert result.outcome == "CONTACT" and "mover_0" in result.message
    assert result.contacts == 1 and result.smallest_clearance < 0.02


def test_a_plugin_that_throws_ends_its_episode_with_its_words(tmp_path):
    result = Episode(task(tmp_path, small_worlds.FREE), with_controller(BLIND, "Throwing"), 1).run()
    assert not result.success
    assert result.outcome == "INTERNAL_ERROR" and "a plugin's mistake" in result.message
    assert len(result.trajectory)


def test_stages_are_timed_by_the_clock_given(tmp_path):
    ticks = iter(range(10**9))
    result = Episode(task(tmp_path, small_worlds.FREE), BLIND, 1, clock=lambda: float(next(ticks))).run()
    assert {"simulation", "costmaps", "navigation", "planning", "control"} <= set(result.machine["stages"])
    assert result.machine["wall"] >= sum(result.machine["stages"].values())


def test_memory_does_not_grow_from_world_to_world():
    setup, held = make_setup(config_folder(), has_map=False), []
    for seed in range(3):
        entry = {**generate("barn", seed), "time_limit": 1.0}
        drive(EpisodeJob(task_of(world_of(Path("generated"), 0, entry)), setup, 1))
        held.append(psutil.Process().memory_info().rss / 2**20)
    assert held[-1] - held[0] < 10.0, f"resident memory (MiB) after each world: {held}"
