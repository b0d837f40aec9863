"""The tune command: better parameters from a bad start, resumed as if never interrupted, and what is refused."""

import json
import math
import sys
from pathlib import Path

import pytest

pytest.importorskip("pybullet")
pytest.importorskip("optuna")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402
import yaml  # noqa: E402
from tally import LONG  # noqa: E402

from mbf_relay.lockstep import batch, compare, tune, tune_picture  # noqa: E402
from mbf_relay.lockstep.result import EpisodeResult  # noqa: E402
from mbf_relay.lockstep.settings import config_folder, parse_change  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.smoothness import Smoothness  # noqa: E402
from mbf_relay.lockstep.trials import value_of  # noqa: E402

SHORT = {**small_worlds.FREE, "goal": [0.2, 0.0, 0.0], "goal_radius": 0.1, "reference_path_length": 0.2}
SAMPLE = Path(__file__).resolve().parents[3] / "config" / "worlds" / "sample.json"
SLOW = ["--set", "controllers=[{name: mine, type: small_worlds.Slow}]", "--set", "mine.pace=0.03", "--jobs", "1"]


def worlds(folder, count):
    return small_worlds.write(folder / "worlds.json", *({**SHORT, "name": f"w{i}"} for i in range(count)))


def trials(folder):
    import optuna

    study = optuna.load_study(study_name="mbf_relay", storage=f"sqlite:///{folder / 'study.db'}")
    return [(trial.params, trial.state.name, trial.value, trial.intermediate_values) for trial in study.get_trials()]


@pytest.mark.parametrize("together, first, count", [("1", "2", "4"), ("4", "3", "6")])
def test_a_bad_start_is_beaten_and_a_resumed_study_is_that_of_one_go(tmp_path, capsys, together, first, count):
    common = [worlds(tmp_path, 2), *SLOW, "--param", "mine.pace=0.03:0.2", "--together", together]
    assert tune.main([*common, "--trials", first, "--out", str(tmp_path / "parts")]) == 0
    assert tune.main([*common, "--trials", count, "--out", str(tmp_path / "parts")]) == 0
    assert tune.main([*common, "--trials", count, "--out", str(tmp_path / "whole")]) == 0
    assert len(trials(tmp_path / "whole")) == int(count)
    assert trials(tmp_path / "parts") == trials(tmp_path / "whole")
    best = yaml.safe_load((tmp_path / "whole" / "best" / "move_base_flex.yaml").read_text())
    assert best["mine"]["pace"] > 0.1
    assert (tmp_path / "whole" / "study.png").read_bytes().startswith(b"\x89PNG")
    assert "  score: +" in capsys.readouterr().out


def test_losing_trials_are_given_up_early_and_never_the_best(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [worlds(tmp_path, 4), *SLOW, "--param", "mine.pace=0.03:0.2", "--trials", "10", "--together", "5"]
    assert tune.main([*arguments, "--out", str(out)]) == 0
    found = trials(out)
    assert {state for _, state, _, _ in found[:5]} == {"COMPLETE"}, "at first there is nothing to be held to"
    given_up = [(value, steps) for _, state, value, steps in found if state == "PRUNED"]
    assert given_up and all(value is None and set(steps) == {0} for value, steps in given_up)
    whole = {value for _, state, value, _ in found if state == "COMPLETE"}
    assert max(steps[0] for _, steps in given_up) < max(whole)
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("trial ")]
    assert len(told) == 10 and sum("(given up)" in line for line in told) == len(given_up)


def test_a_whole_number_is_tuned_in_whole_numbers(tmp_path):
    arguments = ["--param", "DWAPlannerROS.vx_samples=3:5", "--trials", "3", "--jobs", "1"]
    assert tune.main([worlds(tmp_path, 1), *arguments, "--out", str(tmp_path / "out")]) == 0
    found = [next(iter(parameters.values())) for parameters, *_ in trials(tmp_path / "out")]
    assert all(isinstance(value, int) and 3 <= value <= 5 for value in found)
    best = yaml.safe_load((tmp_path / "out" / "best" / "move_base_flex.yaml").read_text())
    assert isinstance(best["DWAPlannerROS"]["vx_samples"], int)


@pytest.mark.parametrize("value", [1e-05, 1e-07, 2.5e-09, 1e16, -3e-05, 0.1, 40, True])
def test_a_number_is_driven_with_however_python_writes_it(value):
    """To YAML 1e-05 is a text: amcl's recovery_alpha_slow could not be tuned from there on, "must be of type float"."""
    (change,) = tune.changes_of({"amcl.recovery_alpha_slow": value})
    name, read = parse_change(change)
    assert name == "amcl.recovery_alpha_slow" and read == value and type(read) is type(value)




@pytest.mark.skipif(not LONG, reason="drives 40 trials through the sample worlds")
def test_forty_trials_on_the_sample_worlds_beat_a_bad_start_for_certain(tmp_path):
    bad = ["--set", "DWAPlannerROS.sim_time=0.3", "--set", "DWAPlannerROS.occdist_scale=0.0",
           "--set", "DWAPlannerROS.path_distance_bias=0.5", "--set", "DWAPlannerROS.max_vel_x=0.06"]
    searched = ["--param", "DWAPlannerROS.sim_time=0.3:3.0", "--param", "DWAPlannerROS.occdist_scale=0.0:0.1",
                "--param", "DWAPlannerROS.path_distance_bias=0.5:64.0", "--param", "DWAPlannerROS.max_vel_x=0.06:0.22"]
    options = [*bad, *searched, "--trials", "40", "--together", "4"]
    assert tune.main([str(SAMPLE), *options, "--out", str(tmp_path / "tuned")]) == 0
    good = ["--config", str(tmp_path / "tuned" / "best")]
    for name, parameters in (("bad", bad), ("good", good)):
        driven = [str(SAMPLE), *parameters, "--seeds", "1001-1003", "--out", str(tmp_path / name)]
        assert batch.main(driven) == 0
    figures = tmp_path / "figures.json"
    assert compare.main([str(tmp_path / "bad"), str(tmp_path / "good"), "--json", str(figures)]) == 0
    difference = json.loads(figures.read_text())["measures"]["score"]["difference"]
    assert difference[1] > 0.0, f"score rose by {difference[0]}, 95 % interval {difference[1]} to {difference[2]}"


@pytest.mark.parametrize(
    "arguments, words",
    [
        ([], "nothing to tune"),
        (["--param", "DWAPlannerROS.vx_samples=3:5.5"], "it is a whole number, and so must its ends be"),
        (["--param", "recovery_enabled=0:1"], "is no number"),
        (["--param", "mine.pace=0.2:0.1"], "the range of mine.pace, 0.2 to 0.1, is empty"),
        (["--param", "mine.pace=fast"], "it must be two numbers"),
        (["--param", "global_costmap.inflation_radius=-1:1"], "is -1.0; it must be at least 0.0 m: 0.0 is used"),
        (["--param", "amcl.min_particles=-3:9"], "min_particles is -3; it must be at least 1"),
        (["--param", "amcl.laser_sigma_hit=0.1:0.3"], "the pose comes from odometry, not from amcl"),
        (["--param", "mine.pase=0.1:0.2"], "did you mean 'move_base_flex.mine.pace'"),
    ],
)
def test_what_cannot_be_tuned_is_named(tmp_path, capsys, arguments, words):
    assert tune.main([worlds(tmp_path, 1), *SLOW, *arguments, "--out", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


@pytest.mark.parametrize("content, words", [("[1, 2]", "holds no ranges"), ("mine.pace: fast", "holds no ranges"), (
    "\n".join(["a0: &a0 [1, 1]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]),
    "aliases unfold")], ids=["a list", "a word", "a bomb of aliases"])
def test_a_space_file_that_holds_no_ranges_is_refused_before_it_fills_the_memory(tmp_path, capsys, content, words):
    file = tmp_path / "space.yaml"
    file.write_text(content)
    common = [worlds(tmp_path, 1), *SLOW, "--space", str(file)]
    assert tune.main([*common, "--out", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line and str(file) in line


def test_a_study_of_other_parameters_is_not_continued(tmp_path, capsys):
    common = [worlds(tmp_path, 1), *SLOW, "--trials", "1", "--out", str(tmp_path / "out")]
    assert tune.main([*common, "--param", "mine.pace=0.1:0.2"]) == 0
    assert tune.main([*common, "--param", "mine.pace=0.1:0.3"]) == 1
    assert "holds a study with other ranges" in capsys.readouterr().err


def broken_at_first(folder, monkeypatch):
    (folder / "study.db").write_text("no database, by any means; what was saved here is gone")


def full_at_the_end_of_a_trial(folder, monkeypatch):
    import optuna
    import sqlalchemy

    full = sqlalchemy.exc.OperationalError("INSERT", {}, OSError("database or disk is full"))
    failed = optuna.exceptions.StorageInternalError("An exception is raised during the commit.")
    failed.__cause__ = full
    monkeypatch.setattr(optuna.Study, "add_trial", lambda study, trial: (_ for _ in ()).throw(failed))


@pytest.mark.parametrize("breaks, words", [
    (broken_at_first, "file is not a database"), (full_at_the_end_of_a_trial, "database or disk is full")])
def test_a_study_that_cannot_be_kept_is_told_in_a_line(tmp_path, capsys, monkeypatch, breaks, words):
    """A folder that cannot be written, or a full disk, showed some fifty lines of a traceback."""
    out = tmp_path / "out"
    out.mkdir()
    breaks(out, monkeypatch)
    common = [worlds(tmp_path, 1), *SLOW, "--trials", "1", "--param", "mine.pace=0.1:0.2"]
    assert tune.main([*common, "--out", str(out)]) == 1
    told = capsys.readouterr().err.splitlines()
    assert told[-1] == f"tune.py: the study in {out} cannot be read or written: {words}"
    assert not any("Traceback" in line for line in told)


@pytest.mark.parametrize("name", ["DWA or MPPI?", "{burger,waffle}", "50%20"])
def test_a_study_lies_in_its_folder_whatever_that_is_called(tmp_path, name):
    """Behind a question mark all were one file beside it, where studies mixed; a brace ended in a traceback."""
    out = tmp_path / name
    arguments = [worlds(tmp_path, 1), *SLOW, "--param", "mine.pace=0.03:0.2", "--trials", "1", "--out", str(out)]
    assert tune.main(arguments) == 0
    assert (out / "study.db").stat().st_size and {path.name for path in tmp_path.iterdir()} == {name, "worlds.json"}


def test_two_searches_in_one_folder_do_not_write_each_other_s_trials(tmp_path, capsys, monkeypatch):
    """Both drove the same trials and noted them twice: of four asked for there were five, and no resuming such a study.
    """
    out = tmp_path / "out"
    common = [worlds(tmp_path, 1), *SLOW, "--trials", "1", "--param", "mine.pace=0.1:0.2", "--out", str(out)]
    told, search = [], tune.search

    def search_beside(*arguments):
        monkeypatch.setattr(tune, "search", search)
        assert tune.main(common) == 1
        told.extend(capsys.readouterr().err.splitlines())
        search(*arguments)

    monkeypatch.setattr(tune, "search", search_beside)
    assert tune.main(common) == 0
    assert told == [f"tune.py: another search is writing to {out}; wait for it or choose another --out"]
    assert len(trials(out)) == 1


def test_what_matters_is_told_from_what_does_not():
    tried = [({"a.much": float(i), "a.none": float((i * 7) % 10)}, 2.0 * i) for i in range(10)]
    found = tune_picture.importances(tried)
    assert list(found) == ["a.much", "a.none"] and found["a.much"] == pytest.approx(1.0) and found["a.none"] < 0.5
    assert tune_picture.importances([({"a": 1.0}, 0.0), ({"a": 2.0}, 0.0), ({"a": 3.0}, 0.0)]) == {"a": 0.0}


def test_the_picture_of_a_search_for_less_shows_the_least_so_far_as_the_best():
    """Its line climbed to the worst trial."""
    assert tune_picture.best_so_far([0.5, 0.7, 0.2, 0.4], -1).tolist() == [0.5, 0.5, 0.2, 0.2]
    assert tune_picture.best_so_far([0.5, 0.7, 0.2, 0.4], 1).tolist() == [0.5, 0.7, 0.7, 0.7]


def test_worlds_made_larger_for_a_large_robot_are_those_it_is_tuned_in(tmp_path):
    """The option was taken and did nothing: a robot of 1.3 m was tuned in worlds for one of 0.15 m."""
    arguments = [worlds(tmp_path, 1), *SLOW, "--param", "mine.pace=0.1:0.2", "--trials", "1", "--scale", "2"]
    assert tune.main([*arguments, "--metric", "error", "--out", str(tmp_path / "out")]) == 0
    assert batch.main([worlds(tmp_path, 1), *SLOW, "--scale", "2", "--out", str(tmp_path / "batch")]) == 0
    import optuna

    study = optuna.load_study(study_name="mbf_relay", storage=f"sqlite:///{tmp_path / 'out' / 'study.db'}")
    driven = json.loads((tmp_path / "batch" / "settings.json").read_text())
    assert study.user_attrs["about"]["worlds_digest"] == driven["worlds_digest"]


def test_what_is_bad_is_tuned_to_be_less_and_the_verdict_is_of_what_was_tuned(tmp_path, capsys):
    """The most violent of six robots would have been called the best of those that were to drive calmly."""
    common = [worlds(tmp_path, 3), *SLOW, "--set", "mine.pace=0.2", "--param", "mine.pace=0.03:0.2", "--trials", "6"]
    out = tmp_path / "out"
    assert tune.main([*common, "--metric", "acceleration, mean", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    paces = {value: parameters["move_base_flex.mine.pace"] for parameters, _, value, _ in trials(out)
             if value is not None}
    best = yaml.safe_load((out / "best" / "move_base_flex.yaml").read_text())["mine"]["pace"]
    assert best == min(paces.values()) and max(paces) < 0.0, "what is maximised is the negative"
    assert "trial 1/6: -" not in shown.err, "people are told the acceleration itself"
    assert "  acceleration, mean: -" in shown.out and "on 1 worlds with 1 seeds each that it was not" in shown.out


def test_what_was_tuned_with_ones_own_plugin_is_driven_with_it_again(tmp_path, capsys, monkeypatch):
    """The best parameters were written without the plugin they are of: the package's drove, and nobody said so."""
    own, out = tmp_path / "own.yaml", tmp_path / "out"
    own.write_text("move_base_flex: {controllers: [{name: mine, type: small_worlds.Slow}]}\n")
    file = worlds(tmp_path, 1)
    common = ["--config", str(own), "--set", "mine.pace=0.05", "--set", "simulator.scan_noise=0.02", "--jobs", "1"]
    assert tune.main([file, *common, "--param", "mine.pace=0.1:0.2", "--trials", "1", "--out", str(out)]) == 0
    (pace,) = trials(out)[0][0].values()
    by_node = yaml.safe_load((out / "best.yaml").read_text())
    assert set(by_node) == {"move_base_flex", "simulator"} and by_node["simulator"] == {"scan_noise": 0.02}
    assert by_node["move_base_flex"] == {"controllers": [{"name": "mine", "type": "small_worlds.Slow"}],
                                         "mine": {"pace": pace}}
    assert yaml.safe_load((out / "best" / "move_base_flex.yaml").read_text()) == by_node["move_base_flex"]
    again = [make_setup(config_folder(), has_map=False, config=out / name).settings for name in ("best", "best.yaml")]
    asked = make_setup(config_folder(), has_map=False, config=own, changes=[
        f"mine.pace={pace!r}", "simulator.scan_noise=0.02"]).settings
    assert again == [asked, asked]


def test_a_single_world_that_serves_the_verdict_as_well_is_not_called_unseen(tmp_path, capsys):
    common = [worlds(tmp_path, 1), *SLOW, "--param", "mine.pace=0.03:0.2", "--trials", "1"]
    assert tune.main([*common, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "on the same 1 worlds, too few to keep any from the tuning, with 1 other seeds each" in shown


@pytest.mark.parametrize("metric, words", [
    ("score", "the worlds state no reference_path_length, so that no drive has a score"),
    ("closest approach", "no drive of trial 1 has a 'closest approach'"),
])
def test_a_metric_that_no_drive_has_is_not_tuned_for(tmp_path, capsys, metric, words):
    """Forty trials of 0 had a best one, which the nodes were then given."""
    bare = {name: value for name, value in SHORT.items() if name != "reference_path_length"}
    file = small_worlds.write(tmp_path / "worlds.json", *({**bare, "name": f"w{i}"} for i in range(3)))
    arguments = [file, *SLOW, "--param", "mine.pace=0.03:0.2", "--metric", metric, "--out", str(tmp_path / "out")]
    assert tune.main(arguments) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("tune.py")]
    assert words in line and not (tmp_path / "out" / "best").exists()


def test_trials_that_cannot_be_driven_are_gone_on_from_and_none_of_them_is_the_best(tmp_path, capsys):
    file = small_worlds.write(tmp_path / "worlds.json", SHORT, small_worlds.BLOCKED_START)
    arguments = [file, *SLOW, "--param", "mine.pace=0.03:0.2", "--metric", "jerk, mean", "--trials"]
    for count in ("9", "10"):
        assert tune.main([*arguments, count, "--out", str(tmp_path / "out")]) == 1
        assert "no trial could drive every world" in capsys.readouterr().err
    assert len(trials(tmp_path / "out")) == 10 and not (tmp_path / "out" / "best").exists()


def test_a_drive_that_failed_is_no_quiet_one():
    quiet, failed = (EpisodeResult("a", seed, outcome == "SUCCEEDED", outcome, smoothness=Smoothness(mean_jerk=0.1))
                     for seed, outcome in ((1, "SUCCEEDED"), (2, "ERROR")))
    assert value_of([quiet], "jerk, mean") == -0.1
    assert value_of([quiet, failed], "jerk, mean") == value_of([failed], "jerk, mean") == -math.inf
    assert value_of([quiet, failed], "success") == 0.5 and value_of([quiet, failed], "error") == -0.5


def test_worlds_of_the_verdict_are_none_of_the_tuning():
    seen, unseen = tune.split(list(range(7)))
    assert unseen == [2, 5] and seen == [0, 1, 3, 4, 6]
