"""The batch command: results, resuming after a kill, interrupts, and what is refused."""

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

pytest.importorskip("pybullet")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402

import mbf_relay  # noqa: E402
from mbf_relay.lockstep import batch, batch_report  # noqa: E402
from mbf_relay.lockstep.cluster import ClusterError  # noqa: E402
from mbf_relay.lockstep.episodes import EpisodeJob, drive  # noqa: E402
from mbf_relay.lockstep.results_file import LINES, read_lines  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import load_tasks, warnings_of  # noqa: E402
from mbf_relay.simulation.description import urdf_of  # noqa: E402
from mbf_relay.simulation.robot_file import load_robot  # noqa: E402
from mbf_relay.simulation.shapes import Box  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / "scripts" / "batch.py"
PACKAGE = Path(mbf_relay.__file__).parents[1]
"""Where it was found: a build's has the kernels, which numba would compile anew in each process."""


def start(*arguments):
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), *arguments], env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, universal_newlines=True,
    )


def wait_for_lines(path, count, process):
    """Wait until a file has so many lines; fail after a minute."""
    for _ in range(600):
        if path.exists() and len(path.read_text().splitlines()) >= count:
            return
        assert process.poll() is None, process.stderr.read()
        pytest.importorskip("select").select([], [], [], 0.1)
    raise AssertionError(f"waited a minute for {count} lines in {path}")


def test_a_batch_leaves_lines_a_summary_and_pictures(tmp_path, capsys):
    worlds = small_worlds.write(
        tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BLOCKED_START, small_worlds.WALLED_IN
    )
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--jobs", "2"]) == 0
    shown = capsys.readouterr()
    assert "blocked_start (seed 1): ERROR" in shown.out and "choose a free place" in shown.out
    results, warnings = read_lines(tmp_path / "out" / LINES)
    assert {result.world: result.success for result in results} == {
        "free": True,
        "blocked_start": False,
        "walled_in": False,
    }
    assert not warnings
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["episodes"] == 3 and summary["success"]["value"] == pytest.approx(1 / 3)
    pictures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert pictures == {"contact_sheet.png", "failure-walled_in-1.png"}
    assert all((tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_pictures_that_could_not_be_drawn_are_not_said_to_be_there(tmp_path, capsys, monkeypatch):
    """On a machine without matplotlib there was none of any failure, and "pictures are in" their folder."""
    monkeypatch.setitem(sys.modules, "mbf_relay.report.picture", None)  # as where something that it imports is missing
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.WALLED_IN)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    assert not (tmp_path / "out" / "failure-walled_in-1.png").exists()
    told = capsys.readouterr()
    assert "pictures are missing, as 1 could not be drawn: ModuleNotFoundError: " in told.err
    assert "pictures are in" not in told.out


def test_a_killed_batch_goes_on_and_drives_nothing_twice(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BENT)
    killed = tmp_path / "killed"
    process = start(worlds, "--out", str(killed), "--seeds", "2", "--jobs", "1")
    wait_for_lines(killed / LINES, 1, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    before, _ = read_lines(killed / LINES)
    assert 1 <= len(before) < 4
    assert batch.main([worlds, "--out", str(killed), "--seeds", "2", "--jobs", "2"]) == 0
    assert batch.main([worlds, "--out", str(tmp_path / "whole"), "--seeds", "2", "--jobs", "1"]) == 0
    resumed, _ = read_lines(killed / LINES)
    whole, _ = read_lines(tmp_path / "whole" / LINES)
    assert len((killed / LINES).read_text().splitlines()) == 4
    key = lambda result: (result.world, result.seed)  # noqa: E731
    assert [r.drive() for r in sorted(resumed, key=key)] == [r.drive() for r in sorted(whole, key=key)]


def test_an_interrupt_loses_nothing_that_was_finished(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BENT)
    out = tmp_path / "out"
    process = start(worlds, "--out", str(out), "--seeds", "20", "--jobs", "1")
    wait_for_lines(out / LINES, 1, process)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130, told
    assert "goes on where this one ended" in told and "Traceback" not in told
    results, warnings = read_lines(out / LINES)
    assert results and not warnings
    assert (out / "summary.json").exists()


def test_what_crashes_is_one_failed_line_that_scores_nothing(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BLOCKED_START)
    crash = "controllers=[{name: own, type: small_worlds.Dying}]"
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--jobs", "2", "--set", crash]) == 0
    results, _ = read_lines(tmp_path / "out" / LINES)
    assert [(result.outcome, result.score) for result in results] == [("ERROR", 0.0)] * 2
    messages = {result.world: result.message for result in results}
    assert "exit status 9" in messages["free"] and "choose a free place" in messages["blocked_start"]


def test_a_mistake_in_a_layer_is_told_by_its_own_line(tmp_path):
    """The line that was told last was one of the package's: "(__exit__, line 87)"."""
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    own = tmp_path / "own.yaml"
    own.write_text("move_base_flex: {local_costmap: {plugins: [{name: own, type: small_worlds.Forgetful}]}}")
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--jobs", "1", "--config", str(own)]) == 0
    (result,), _ = read_lines(tmp_path / "out" / LINES)
    line = next(number for number, text in enumerate(Path(small_worlds.__file__).read_text().splitlines(), 1)
                if '{}["size"]' in text)
    assert result.message == f"layer 'own' failed with KeyError: 'size' (small_worlds.py, line {line})"


def test_an_episode_that_computes_for_ever_is_ended_and_driven_again_on_request(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR, small_worlds.BENT)
    hang = "controllers=[{name: own, type: small_worlds.Hanging}]"
    arguments = [worlds, "--out", str(tmp_path / "out"), "--jobs", "1", "--time-limit", "0.5", "--set", hang]
    assert batch.main(arguments) == 0
    results, _ = read_lines(tmp_path / "out" / LINES)
    assert len(results) == 2
    assert all("hung: no result within 0.5 s of computing" in result.message for result in results)
    assert batch.main(arguments) == 0
    assert "2 of 2 episodes have a result already" in capsys.readouterr().err
    assert batch.main([*arguments, "--retry-failed", "--only", "free"]) == 0
    assert len((tmp_path / "out" / LINES).read_text().splitlines()) == 3
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["episodes"] == 2


def test_results_of_other_code_are_not_continued(tmp_path, capsys, monkeypatch):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.BLOCKED_START)
    assert batch.main([worlds, "--out", str(tmp_path / "out")]) == 0
    monkeypatch.setattr("mbf_relay.lockstep.sources.package_digest", lambda: "other")
    assert batch.main([worlds, "--out", str(tmp_path / "out")]) == 1
    assert "holds results of other code (sources was" in capsys.readouterr().err


def test_who_edits_the_package_while_a_batch_runs_gets_its_summary_and_a_line_for_the_pictures(
        tmp_path, capsys, monkeypatch):
    """It ended in a traceback behind hours of driving, for no worker had the sources of its start."""
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.BLOCKED_START)

    def none_is_fit(*_arguments, **_options):
        raise ClusterError("no worker is fit; it has sources 'b', here is 'a'")

    monkeypatch.setattr(batch_report, "workers_for", none_is_fit)
    assert batch.main([worlds, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    assert "no worker is fit; it has sources 'b', here is 'a'" in shown.err
    assert "results and summary are in" in shown.out and (tmp_path / "out" / "summary.json").exists()


def test_seeds_are_a_number_or_a_range(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.BLOCKED_START)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--seeds", "10-12", "--jobs", "1"]) == 0
    assert sorted(result.seed for result in read_lines(tmp_path / "out" / LINES)[0]) == [10, 11, 12]
    with pytest.raises(SystemExit):
        batch.main([worlds, "--seeds", "7-3"])
    assert "'7-3' holds no seed" in capsys.readouterr().err


def test_a_world_that_was_edited_is_named_when_a_batch_goes_on(tmp_path, capsys):
    out, file = str(tmp_path / "out"), tmp_path / "worlds.json"
    mover = {**small_worlds.RUN_OVER["movers"][0], "waypoints": [[0.0, 1.0, 2.0], [4.0, 1.0, 3.0]], "loop": True}
    walked = {**small_worlds.NEAR, "name": "walked", "movers": [mover]}
    arguments = [small_worlds.write(file, small_worlds.NEAR, walked), "--jobs", "1", "--out", out]
    assert batch.main(arguments) == 0
    digests = json.loads((tmp_path / "out" / "settings.json").read_text())["world_digests"]
    assert set(digests) == {"free", "walked"}
    small_worlds.write(file, small_worlds.NEAR, {**walked, "movers": [{**mover, "loop": False}]})
    capsys.readouterr()
    assert batch.main(arguments) == 1
    assert "holds results of other settings (world 'walked' is another one now)" in capsys.readouterr().err


def test_a_robot_of_ones_own_goes_with_the_work_and_an_edited_one_is_another(tmp_path, capsys, monkeypatch):
    """Its file was read where a worker happened to stand, and one that was edited went on in the same table."""
    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path / "home")
    robot = Path("mine.yaml")
    robot.write_text((ROOT / "config" / "robot" / "burger.yaml").read_text())
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR)
    arguments = [worlds, "--robot", "mine.yaml", "--jobs", "1", "--out", str(tmp_path / "out")]
    assert batch.main(arguments) == 0
    setup = make_setup(config_folder(), has_map=False, robot="mine.yaml")
    sent = pickle.dumps(EpisodeJob(load_tasks(worlds)[0], setup, 1))
    robot.write_text(robot.read_text() + "\n# edited\n")
    capsys.readouterr()
    assert batch.main(arguments) == 1
    assert "holds results of other settings (robot_digest was" in capsys.readouterr().err
    monkeypatch.chdir(tmp_path)
    result = drive(pickle.loads(sent))
    assert result.success, result.message
    assert result.digest == read_lines(tmp_path / "out" / LINES)[0][0].digest


def test_a_robot_whose_mesh_was_edited_is_another(tmp_path):
    """Its description names the mesh and stays as it was: the narrower robot's drives counted for the wider one."""
    def digest(folder, width):
        corners = Box((width, width, 0.1)).triangles().reshape(-1, 3).tolist()
        lines = ["v {} {} {}".format(*corner) for corner in corners]
        lines += [f"f {first} {first + 1} {first + 2}" for first in range(1, len(corners), 3)]
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "hull.obj").write_text("\n".join(lines))
        robot = tmp_path / folder / "mine.urdf"
        robot.write_text(described.replace(hull, '<mesh filename="file://hull.obj"/>'))
        return batch.settings_of("x", [], make_setup(config_folder(), has_map=False, robot=str(robot)))["robot_digest"]

    described, hull = urdf_of(load_robot("small")), '<cylinder radius="0.1" length="0.11" />'
    assert hull in described
    assert digest("as_it_was", 0.2) == digest("elsewhere", 0.2) != digest("wider", 0.24)


def test_parameters_of_ones_own_that_mean_nothing_are_told_before_a_night_is_driven_without_them(tmp_path, capsys):
    own = tmp_path / "own.yaml"
    own.write_text(
        "move_base_flex:\n  DWAPlannerROS: {sim_tim: 2.0, sim_time: 1.5}\n"
        "  local_costmap: {inflation_layer: {inflation_radus: 0.9}}\n  nonsense: 3\n  straight: {weave: 0.1}\n"
        "amcl: {min_particle: 3, initial_pose_x: 1.0}\nsimulator: {scan_nois: 0.3, truth_rate: 30.0}\n"
    )
    arguments = [small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR), "--jobs", "1"]
    assert batch.main([*arguments, "--config", str(own), "--out", str(tmp_path / "own")]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("batch.py: ")]
    for name, hint in (("move_base_flex.DWAPlannerROS.sim_tim", "'sim_time'"), ("move_base_flex.nonsense", ""),
                       ("move_base_flex.local_costmap.inflation_radus", "'inflation_radius'"),
                       ("move_base_flex.straight", ""), ("amcl.min_particle", "'min_particles'"),
                       ("simulator.scan_nois", "'scan_noise'")):
        (line,) = [line for line in told if line.startswith(f"batch.py: {name}: ")]
        assert hint in line
    assert len(told) == 6
    changed = ["--set", "DWAPlannerROS.sim_time=2.0", "--robot", "car", "--out", str(tmp_path / "car")]
    assert batch.main([*arguments, *changed]) == 0
    assert "batch.py: " not in capsys.readouterr().err, "what the package's own files leave unused is no news"


def test_worlds_of_which_some_have_a_map_are_not_all_driven_without(tmp_path, capsys):
    mapped = {**small_worlds.NEAR, "name": "mapped", "map": str(ROOT / "config" / "maps" / "turtlebot3_world.yaml")}
    file = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR, mapped)
    arguments = [file, "--jobs", "1", "--out", str(tmp_path / "out")]
    assert batch.main(arguments) == 1
    told = capsys.readouterr().err
    assert "world 'mapped' has a map of its own, and world 'free' has none; say --map known" in told
    assert batch.main([*arguments, "--map", "none", "--only", "free"]) == 0
    assert batch.main([file, "--jobs", "1", "--only", "free", "--out", str(tmp_path / "free")]) == 0
    assert json.loads((tmp_path / "free" / "settings.json").read_text())["map"] == "none"


def test_own_parameters_lie_over_the_packages_and_plugins_of_ones_own_have_theirs(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    own = tmp_path / "move_base_flex.yaml"
    own.write_text("controllers: [{name: mine, type: small_worlds.Slow}]\nmine: {pace: 0.1}\n")
    common = [worlds, "--jobs", "1", "--config", str(own)]
    assert batch.main([*common, "--out", str(tmp_path / "a")]) == 0
    assert batch.main([*common, "--out", str(tmp_path / "b"), "--set", "mine.pace=0.2"]) == 0
    (slow,), (quick,) = (read_lines(tmp_path / name / LINES)[0] for name in ("a", "b"))
    assert slow.success and quick.success and slow.time > 1.5 * quick.time
    assert batch.main([*common, "--out", str(tmp_path / "c"), "--set", "mine.pase=0.2"]) == 1
    assert "did you mean 'move_base_flex.mine.pace'" in capsys.readouterr().err
    settings = json.loads((tmp_path / "a" / "settings.json").read_text())
    assert list(settings["plugins"]) == ["small_worlds.Slow"] and len(settings["sources"]) == 16
    (tmp_path / "mine.yaml").write_text("DWAPlannerROS: {sim_time: 2.0}")
    assert batch.main([worlds, "--config", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "d")]) == 1
    assert "has 'DWAPlannerROS' at its first level; it must be named after a node" in capsys.readouterr().err


def test_a_ci_that_requires_drives_to_succeed_is_red_where_they_fail(tmp_path, capsys):
    """The status was 0 where every drive failed, and there was no way to ask for another."""
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR, small_worlds.BLOCKED_START)
    common = [worlds, "--jobs", "1", "--out", str(tmp_path / "out")]
    assert batch.main(common) == 0
    assert batch.main([*common, "--require", "0.5"]) == 0
    assert batch.main([*common, "--require", "0.6"]) == 1
    assert "1 of 2 drives succeeded, and --require asks for 0.6 of them" in capsys.readouterr().err
    assert batch.main([*common, "--only", "free", "--require", "1"]) == 0, "the others were not asked for"
    with pytest.raises(SystemExit):
        batch.main([*common, "--require", "95"])


def test_a_goal_beyond_all_walls_is_on_the_known_map(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", {**small_worlds.FREE, "goal": [3.5, 0.0, 0.0]})
    out = ["--out", str(tmp_path / "out"), "--jobs", "1"]
    assert batch.main([worlds, *out, "--map", "known", "--map-resolution", "0.04"]) == 0
    (result,), _ = read_lines(tmp_path / "out" / LINES)
    assert result.success, result.message


def test_a_world_may_name_a_map_that_is_wrong(tmp_path, capsys):
    image = np.full((80, 120), 254, np.uint8)
    image[:, 60] = 0  # a wall from end to end that is not there
    PIL.Image.fromarray(image).save(tmp_path / "wrong.png")
    (tmp_path / "wrong.yaml").write_text(
        "{image: wrong.png, resolution: 0.05, origin: [-2, -2, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"
    )
    worlds = small_worlds.write(tmp_path / "worlds.json", {**small_worlds.FREE, "map": "wrong.yaml", "time_limit": 5})
    assert batch.main([worlds, "--out", str(tmp_path / "a"), "--jobs", "1", "--localization", "truth"]) == 0
    (result,), _ = read_lines(tmp_path / "a" / LINES)
    assert not result.success and json.loads((tmp_path / "a" / "settings.json").read_text())["map"] == "known"
    worlds = small_worlds.write(tmp_path / "none.json", {**small_worlds.FREE, "map": "none.yaml"})
    assert batch.main([worlds, "--out", str(tmp_path / "b")]) == 1
    assert "the map of world 'free'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--set", "DWAPlannerROS.sim_tim=2"], "did you mean 'move_base_flex.DWAPlannerROS.sim_time'"),
        (["--set", "sim_time"], "must have the form"),
        (["--controller", "TEB"], "there is no 'TEB' among the controllers"),
        (["--planner", "RRT"], "there is no 'RRT' among the planners"),
        (["--localization", "amcl", "--map", "none"], "amcl needs a map"),
        (["--only", "elsewhere"], "there is no world 'elsewhere'; there are free"),
        (["--set", "DWAPlannerROS.sim_time=fast"], "sim_time is 'fast'"),
    ],
)
def test_what_is_wrong_is_named_before_anything_is_driven(tmp_path, capsys, arguments, words):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), *arguments]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out" / LINES).exists()


def test_what_is_misspelt_in_a_worlds_file_is_told(tmp_path, capsys):
    """With "goal_raduis" goals counted as reached a metre away, and nobody was told."""
    misspelt = {**small_worlds.FREE, "goal_raduis": 0.1, "time_limit": 0.1}
    worlds = small_worlds.write(tmp_path / "worlds.json", *({**misspelt, "name": f"w{i}"} for i in range(7)))
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--only", "w6", "--jobs", "1"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line for line in told if "batch.py" in line] == ["batch.py: 'goal_raduis' of world w6 is not understood"]
    assert warnings_of(load_tasks(worlds)) == [
        *(f"'goal_raduis' of world w{i} is not understood" for i in range(5)),
        "and 2 more such lines on the worlds"]


def test_a_reader_of_the_summary_that_has_gone_costs_no_result(tmp_path):
    """`batch.py … | head` ended with "Broken pipe" before summary, table and pictures were written."""
    worlds = small_worlds.write(tmp_path / "worlds.json", {**small_worlds.FREE, "time_limit": 0.1})
    process = start(worlds, "--out", str(tmp_path / "out"), "--jobs", "1")
    process.stdout.close()
    told = process.stderr.read()
    assert process.wait() == 0 and "roken" not in told
    assert {"summary.json", "results.csv", "contact_sheet.png"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_a_batch_of_one_world_can_be_widened(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR, {**small_worlds.NEAR, "name": "nearer"})
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--only", "nearer"]) == 0
    assert batch.main([worlds, "--out", str(tmp_path / "out")]) == 0
    assert "1 of 2 episodes have a result already" in capsys.readouterr().err
    assert len((tmp_path / "out" / LINES).read_text().splitlines()) == 2


def test_a_missing_worlds_file_is_named(tmp_path, capsys):
    assert batch.main([str(tmp_path / "none.json"), "--out", str(tmp_path / "out")]) == 1
    assert "none.json cannot be read" in capsys.readouterr().err


def test_changed_parameters_change_the_drive_and_need_another_folder(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    assert batch.main([worlds, "--out", str(tmp_path / "a")]) == 0
    slower = ["--set", "DWAPlannerROS.max_vel_x=0.12", "--set", "DWAPlannerROS.max_vel_trans=0.12"]
    assert batch.main([worlds, "--out", str(tmp_path / "b"), *slower]) == 0
    (fast,), (slow,) = (read_lines(tmp_path / name / LINES)[0] for name in ("a", "b"))
    assert slow.success and slow.time > 1.4 * fast.time
    assert batch.main([worlds, "--out", str(tmp_path / "a"), *slower]) == 1
    assert "max_vel_" in capsys.readouterr().err
