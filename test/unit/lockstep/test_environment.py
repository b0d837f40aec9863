"""The gymnasium environment: its contract, one seed one episode, rewards that mean what they say, and learning."""

import copy
import pickle
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")
gymnasium = pytest.importorskip("gymnasium")
sys.path.insert(0, str(Path(__file__).parent))

import readmes  # noqa: E402
import small_worlds  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

import mbf_relay  # noqa: E402
from mbf_relay.lockstep import cross_entropy  # noqa: E402
from mbf_relay.lockstep.environment import ID, NavigationEnvironment, vectorised  # noqa: E402

AHEAD, STAND = np.array([1.0, 0.0]), np.array([0.0, 0.0])
NEAR = {**small_worlds.FREE, "cylinders": [], "goal": [0.6, 0.0, 0.0], "goal_radius": 0.3, "time_limit": 4.0}
WALL = {**NEAR, "name": "wall", "boxes": [[0.35, 0.0, 0.0, 0.1, 1.0, 0.5]]}


@pytest.fixture
def made(tmp_path):
    """Return what makes an environment of some worlds; all are closed in the end."""
    everything = []

    def make(*worlds, **arguments):
        source = small_worlds.write(tmp_path / "worlds.json", *worlds) if worlds else arguments.pop("worlds", "barn")
        everything.append(NavigationEnvironment(source, **arguments))
        return everything[-1]

    yield make
    for environment in everything:
        environment.close()


def run(environment, action, seed=1, **options):
    """Return every reward and the last step of an episode with one action."""
    environment.reset(seed=seed, options=options)
    rewards = []
    while True:
        observation, reward, terminated, truncated, info = environment.step(action)
        rewards.append(reward)
        assert environment.observation_space.contains(observation)
        if terminated or truncated:
            return rewards, terminated, truncated, info


def test_a_policy_is_not_trained_untold_in_a_world_that_lacks_what_its_file_misspells(made):
    """`cylindres` were nowhere, and the policy learnt to drive without them; batch.py told of it."""
    with pytest.warns(UserWarning, match="cylindres"):
        made({**NEAR, "cylindres": [[0.3, 0.0, 0.0, 0.1, 0.5]]})
    with pytest.warns(UserWarning, match="imu_rate: has no effect in these drives"):
        made(NEAR, changes="simulator.imu_rate=40")


def test_an_episode_that_was_not_asked_for_is_not_driven_in_its_place(made):
    """A policy was judged in worlds by chance, where its author had misspelt the one, or asked for a number of a file.
    """
    with pytest.raises(ValueError, match="no option 'wrold' of the worlds of a file; one is chosen by 'world'"):
        made(NEAR, WALL).reset(seed=1, options={"wrold": "wall"})
    with pytest.raises(ValueError, match="no option 'world' of worlds that are generated; .* by 'world_seed'"):
        made(worlds="corridor").reset(seed=1, options={"world": "wall"})
    with pytest.raises(ValueError, match="changes are of move_base_flex, which takes no part here"):
        made(NEAR, changes=["DWAPlannerROS.sim_time=2.5"])


def test_a_policy_meets_the_faults_that_are_asked_for(made):
    ways = [run(made(NEAR, changes=changes), AHEAD)[3]["time"] for changes in ([], ["simulator.faults.slip=0.5"])]
    assert ways[1] > 1.5 * ways[0]
    blind = made(NEAR, changes=["simulator.faults.lidar_silent=true"])
    seen, _ = blind.reset(seed=1)
    assert np.array_equal(blind.step(AHEAD)[0]["scan"], seen["scan"])


@pytest.mark.parametrize("robot", ["", "omni", "car"])
def test_gymnasium_has_nothing_to_object_to(robot):
    environment = gymnasium.make(f"mbf_relay.lockstep.environment:{ID}", worlds="corridor", robot=robot).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment)
    environment.close()
    assert environment.action_space.shape == ((3,) if robot == "omni" else (2,))


def test_the_readme_s_lines_drive():
    lines = {}
    exec(compile(readmes.block_with("python", "Navigation-v0"), "README.md", "exec"), lines)
    assert lines["info"]["world"].startswith("barn_") and not lines["terminated"]
    lines["environment"].close()


def test_one_seed_is_one_episode_and_another_one_another(made):
    def episode(seed):
        environment = made(worlds="barn")
        rows = [environment.reset(seed=seed)[0]]
        rows += [environment.step(np.array([0.8, 0.1 * turn]))[0] for turn in (-1, 0, 1, 2)]
        return np.concatenate([row[name] for row in rows for name in sorted(row)])

    first, again, other = episode(5), episode(5), episode(6)
    assert (first == again).all() and (first != other).any()


def test_worlds_kept_from_training_are_not_met_in_it(made):
    training, test = made(worlds="maze", seeds=(10, 12)), made(worlds="maze", seeds=(0, 2))
    names = [{environment.reset(seed=seed)[1]["world"] for seed in range(8)} for environment in (training, test)]
    assert names == [{"maze_0010", "maze_0011"}, {"maze_0000", "maze_0001"}]


def test_a_goal_reached_pays_progress_and_bonus_and_costs_time(made):
    environment = made(NEAR, reward_progress=2.0, reward_goal=7.0, reward_time=-0.5)
    before = environment.reset(seed=1)[1]["distance"]
    rewards, terminated, truncated, info = run(environment, AHEAD)
    assert terminated and not truncated and info["success"] and info["distance"] <= 0.3
    seconds = len(rewards) / environment.parameters.control_rate
    assert sum(rewards) == pytest.approx(2.0 * (before - info["distance"]) + 7.0 - 0.5 * seconds, abs=1e-3)


def test_a_wall_ends_the_episode_at_its_price_and_stands_in_the_scan(made):
    environment = made(NEAR, WALL, reward_progress=0.0, reward_contact=-3.0, reward_time=0.0)
    seen, _ = environment.reset(seed=1, options={"world": "wall"})
    assert seen["scan"][0] == pytest.approx(0.3 + 0.032, abs=0.06) and seen["scan"].max() == pytest.approx(3.5)
    assert seen["goal"] == pytest.approx([0.6, 0.0], abs=1e-3)
    rewards, terminated, truncated, info = run(environment, AHEAD, world="wall")
    assert terminated and not info["success"] and sum(rewards) == -3.0
    environment.reset(seed=1, options={"world": "wall"})
    standing = [environment.step(STAND)[1] for _ in range(3)]
    assert standing == [0.0, 0.0, 0.0]


def test_time_that_is_up_truncates(made):
    rewards, terminated, truncated, info = run(made(NEAR), STAND)
    assert truncated and not terminated and not info["success"] and info["time"] == pytest.approx(4.0, abs=0.5)


def test_every_goal_of_the_circle_counts(made):
    environment = made(worlds="circle", goal_radius=20.0)
    environment.reset(seed=1)
    ends = [environment.step(STAND) for _ in range(8)]
    assert [step[2] for step in ends] == 7 * [False] + [True]
    assert ends[-1][4]["goals_reached"] == 8 and ends[-1][4]["success"]
    assert max(abs(step[1]) for step in ends) == pytest.approx(5.0, abs=0.1), "another goal is no way back"


def test_odometry_that_errs_is_what_a_robot_without_truth_is_told(made):
    slipping = dict(changes=["simulator.odom_bias=[0.3, 0.3]"])
    told = {}
    for localization in ("truth", "odometry"):
        environment = made(NEAR, localization=localization, **slipping)
        environment.reset(seed=1)
        for _ in range(6):
            seen, *_, info = environment.step(AHEAD)
        told[localization] = float(seen["goal"][0]) - info["distance"]
    assert abs(told["truth"]) < 0.01 and told["odometry"] < -0.03


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"worlds": "no.json"}, "no.json cannot be read"),
        ({"reward_gaol": 1.0}, "did you mean 'reward_goal'"),
        ({"control_rate": 7.0}, "control_rate is 7.0 Hz; it must divide"),
        ({"localization": "amcl"}, "must be 'truth' or 'odometry'"),
        ({"seeds": (5, 5)}, r"seeds are \(5, 5\)"),
        ({"seeds": (5,)}, r"seeds are \(5,\); they must be two"),
        ({"seeds": 5}, "seeds are 5; they must be two"),
        ({"seeds": (0, 10, 20)}, r"seeds are \(0, 10, 20\); they must be two"),
        ({"changes": "simulator.scan_rate=0"}, "needs lidar and odometry"),
        ({"changes": ["simulator.scan_rate=0"]}, "needs lidar and odometry"),
    ],
)
def test_what_cannot_be_made_is_named(made, arguments, words):
    with pytest.raises(ValueError, match=words):
        made(**arguments)


def test_what_cannot_be_done_is_named(made):
    environment = made(NEAR)
    with pytest.raises(ValueError, match=r"call reset\(\) first"):
        environment.step(AHEAD)
    with pytest.raises(ValueError, match="no world 'far'; there are free"):
        environment.reset(seed=1, options={"world": "far"})
    environment.reset(seed=1)
    with pytest.raises(ValueError, match="not finite"):
        environment.step(np.array([np.nan, 0.0]))
    with pytest.raises(ValueError, match=r"shape \(3,\); it must be \(2,\)"):
        environment.step(np.zeros(3))


@pytest.mark.parametrize("copied", [copy.deepcopy, pickle.dumps])
def test_a_copy_does_not_drive_the_robot_of_the_environment_it_was_made_of(made, copied):
    """A search that tried actions on copies drove the one robot on; closed, they left two later worlds in one."""
    environment = made(NEAR)
    copied(environment)
    environment.reset(seed=1)
    with pytest.raises(TypeError, match=r"cannot be copied or pickled, .*before reset\(\) or after close\(\)"):
        copied(environment)
    environment.close()
    copied(environment)


def test_its_processes_find_the_package_where_this_one_does(monkeypatch):
    """A built package stands in front of its sources, and has the kernels: each compiled them anew, for ten seconds."""
    before, told = list(sys.path), []
    monkeypatch.setattr(gymnasium.vector, "AsyncVectorEnv", lambda *_, **__: told.append(list(sys.path)))
    vectorised(2)
    assert told[0][0] == str(Path(mbf_relay.__file__).parents[1]) and sys.path == before


def test_several_drive_at_once_as_each_would_alone(tmp_path, made):
    worlds = small_worlds.write(tmp_path / "worlds.json", NEAR, WALL)
    together = vectorised(2, worlds=worlds)
    try:
        together.reset(seed=[3, 4])
        seen = together.step(np.array([AHEAD, -AHEAD]))[0]
    finally:
        together.close()
    for index, (seed, action) in enumerate(((3, AHEAD), (4, -AHEAD))):
        alone = made(NEAR, WALL)
        alone.reset(seed=seed)
        for name, value in alone.step(action)[0].items():
            assert (seen[name][index] == value).all()


def test_rewards_teach_a_policy_to_drive(made):
    environment = made({**NEAR, "goal": [0.4, 0.6, 0.0], "time_limit": 6.0}, beams=cross_entropy.SECTORS)
    told = []
    weights, returns = cross_entropy.train(environment, 6, 12, 1, 1, told.append)
    assert len(told) == 6 and returns[-1] > returns[0] + 1.0
    untaught = cross_entropy.drive(environment, np.zeros_like(weights), [7])
    taught = cross_entropy.drive(environment, weights, [7])
    assert untaught == (pytest.approx(-0.12, abs=0.05), 0.0) and taught[1] == 1.0


def test_the_example_tells_what_was_learnt(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", {**NEAR, "time_limit": 1.0})
    assert cross_entropy.main(["--worlds", worlds, "--generations", "1", "--policies", "3", "--episodes", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["generation", "before,", "after,"]
    assert cross_entropy.main(["--worlds", str(tmp_path / "none.json")]) == 1
    assert "none.json cannot be read" in capsys.readouterr().err
    for name in ("generations", "policies", "episodes"):  # of none, a traceback told
        with pytest.raises(SystemExit):
            cross_entropy.main(["--worlds", worlds, f"--{name}", "0"])
        assert f"--{name}: 0 is below 1" in capsys.readouterr().err


def test_who_has_no_gymnasium_is_told_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "mbf_relay.lockstep.environment")
    assert cross_entropy.main([]) == 1
    assert "pip install gymnasium" in capsys.readouterr().err
