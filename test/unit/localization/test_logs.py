import json
from dataclasses import replace

import numpy as np
import pytest
from benchmark.synthetic_drives import Rough, make_drive
from PIL import Image

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.command import main
from mbf_relay.localization.logs import LogError, guess_range_max, load_log, save_log
from mbf_relay.maps import save_map


def arrays(count=4, beams=5):
    return dict(
        t=np.arange(float(count)),
        odom=np.zeros((count, 3)),
        ranges=np.ones((count, beams)),
        angle_min=-1.0,
        angle_increment=0.5,
        ref=np.zeros((count, 3)),
        laser_pose=np.array([0.1, 0.0, 0.2]),
    )


def test_logs_come_back_as_they_were_saved(tmp_path):
    made = make_drive("hall", 5, Rough(), np.random.default_rng(1))
    save_log(str(tmp_path / "log.npz"), replace(made.log, range_min=0.02))
    again = load_log(str(tmp_path / "log.npz"))
    assert again.range_min == again.scan(0).range_min == 0.02
    for name in ("times", "odom", "ranges", "reference"):
        assert np.array_equal(getattr(again, name), getattr(made.log, name))
    assert (again.angle_min, again.angle_increment, again.range_max) == (
        made.log.angle_min, made.log.angle_increment, made.log.range_max,
    )
    assert again.laser_pose == made.log.laser_pose


def test_reference_and_laser_pose_may_be_missing(tmp_path):
    values = arrays()
    del values["ref"], values["laser_pose"]
    np.savez(str(tmp_path / "log.npz"), **values)
    log = load_log(str(tmp_path / "log.npz"))
    assert log.reference is None and log.laser_pose == Pose2D(0.0, 0.0, 0.0) and len(log) == 4


@pytest.mark.parametrize(
    "change, complaint",
    [
        (dict(t=None), "no array 't'"),
        (dict(odom=np.zeros((3, 3))), "'odom' of log .* shape \\(3, 3\\)"),
        (dict(ranges=np.ones(4)), "'ranges'"),
        (dict(laser_pose=np.ones(2)), "laser_pose"),
        (dict(ref=np.zeros((4, 2))), "'ref'"),
        (dict(ranges=np.ones((4, 0))), "'ranges'"),
        (dict(angle_min=np.nan), "angle_min and angle_increment of log .* are nan and 0.5"),
        (dict(angle_increment=0.0), "are -1.0 and 0.0"),
        (dict(angle_min=np.zeros(2)), "'angle_min' of log .* must be one number"),
        (dict(range_max=np.nan), "'range_max' of log .* is nan"),
        (dict(range_min=-0.1), "'range_min' of log .* is -0.1"),
        (dict(range_min=5.0, range_max=4.0), "'range_min' of log .* is 5.0"),
        (dict(range_min=np.nan), "'range_min' of log .* is nan"),
        (dict(odom=np.full((4, 3), 1e200)), "'odom' of log .* goes to 1e\\+200 m"),
    ],
)
def test_wrong_logs_are_named_with_what_is_wrong(tmp_path, change, complaint):
    values = {name: value for name, value in {**arrays(), **change}.items() if value is not None}
    np.savez(str(tmp_path / "log.npz"), **values)
    with pytest.raises(LogError, match=complaint):
        load_log(str(tmp_path / "log.npz"))
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(LogError, match="text.npz"):
        load_log(str(tmp_path / "text.npz"))


def test_the_sensors_word_for_nothing_is_found_in_the_readings():
    rng = np.random.default_rng(1)
    ranges = rng.uniform(0.5, 12.0, (100, 180))
    assert guess_range_max(ranges) == pytest.approx(12.0, abs=0.03)
    nothing = ranges.copy()
    nothing[rng.random(nothing.shape) < 0.1] = 81.91
    assert 12.0 < guess_range_max(nothing) < 81.91
    nothing[rng.random(nothing.shape) < 0.05] = 81.83
    assert 12.0 < guess_range_max(nothing) < 81.83
    assert guess_range_max(np.full((3, 3), np.nan)) > 0.0


def test_the_command_writes_way_figures_and_picture(tmp_path, capsys):
    made = make_drive("hall", 30, Rough(), np.random.default_rng(1))
    save_log(str(tmp_path / "log.npz"), made.log)
    save_map(str(tmp_path / "map"), made.occupancy)
    (tmp_path / "amcl.yaml").write_text("amcl:\n  max_particles: 1000\n  initial_pose_x: 99.0\n")
    out = tmp_path / "out"
    status = main([
        str(tmp_path / "log.npz"), str(tmp_path / "map.yaml"), "--params", str(tmp_path / "amcl.yaml"), "--seed", "3",
        "--out", str(out),
    ])
    assert status == 0
    figures = json.loads((out / "result.json").read_text())
    for name in ("translation_error", "rotation_error", "seconds_per_update"):
        assert set(figures[name]) == {"mean", "median", "p95", "max"}
    assert figures["translation_error"]["median"] < 0.1
    assert figures["seconds_per_update"]["mean"] > 0.0
    rows = np.loadtxt(str(out / "trajectory.csv"), delimiter=",", skiprows=1)
    assert rows.shape == (30, 6)
    assert Image.open(str(out / "result.png")).size[0] > 300
    printed = capsys.readouterr().out
    assert "translation error [m]: mean" in printed and "time per update [ms]" in printed


def test_many_logs_seeds_and_stresses_give_a_table_with_intervals(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, seed in (("one", 1), ("other", 2)):
        made = make_drive("hall", 12, Rough(beams=60), np.random.default_rng(seed))
        save_log(f"{name}.npz", made.log)
        save_map(name, made.occupancy)
    files = ["one.npz", "one.yaml", "other.npz", "other.yaml"]
    assert main([*files, "--seeds", "2", "--stress", "unmapped=0.9,every=2", "--out", "out"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 2 * 3 and "within 0.5 m" in lines[0]
    assert lines[1].startswith("one.npz") and "as recorded" in lines[1] and "[" in lines[1]
    assert lines[6].startswith("all") and "unmapped=0.9 every=2" in lines[6]
    rows = json.loads((tmp_path / "out" / "trials.json").read_text())
    assert [row["trials"] for row in rows] == [2, 2, 4, 2, 2, 4]
    assert all(row["right"]["low"] <= row["right"]["value"] <= row["right"]["high"] for row in rows)
    recorded, stressed = (row["right"]["value"] for row in rows if row["log"] == "all")
    assert recorded > 0.9 > stressed


@pytest.mark.parametrize("more", [[], ["--seeds", "2"]])
def test_a_folder_that_cannot_be_written_is_refused_before_the_replay(tmp_path, capsys, monkeypatch, more):
    """Hours of trials were lost to a file of that name."""
    made = make_drive("hall", 5, Rough(), np.random.default_rng(5))
    save_log(str(tmp_path / "log.npz"), made.log)
    save_map(str(tmp_path / "map"), made.occupancy)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    for place in ("command", "trials"):
        monkeypatch.setattr(f"mbf_relay.localization.{place}.replay", lambda *_, **__: pytest.fail("replayed first"))
    assert main(["log.npz", "map.yaml", "--out", "taken", *more]) == 1
    assert "'taken'" in capsys.readouterr().err


def test_a_log_without_a_scan_is_told_so(tmp_path):
    """It had shape (0, 5) and was to have (0, beams)."""
    np.savez(tmp_path / "none.npz", **{name: value[:0] if np.shape(value)[:1] == (4,) else value
                                       for name, value in arrays().items()})
    with pytest.raises(LogError, match=r"has shape \(0, 5\); it must have a scan"):
        load_log(str(tmp_path / "none.npz"))


@pytest.mark.parametrize("text, status, told", [
    ("amcl: {min_particels: 50, seed: 3, initial_pose_x: 0.0}", 0,
     "parameter file amcl.yaml: min_particels is not known here; did you mean 'min_particles'?"),
    ("move_base_flex: {odom_topic: odom}", 0, "parameter file amcl.yaml: move_base_flex is not known here"),
    ("amcl:  # {min_particles: 50}", 0, ""),
    ("initial_pose_x: here", 1, "parameter file amcl.yaml: parameter initial_pose_x is 'here'; it must be a finite "
     "number, of a covariance 0 or more"),
    ("amcl: 3", 1, "parameter file amcl.yaml holds int; it must hold names and values"),
])
def test_what_a_parameter_file_says_in_vain_is_told(tmp_path, capsys, monkeypatch, text, status, told):
    """A slip in a name left the default, and two filters that were compared were one; an empty group was a traceback.
    """
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 5, Rough(beams=60), np.random.default_rng(1))
    save_log("one.npz", made.log)
    save_map("one", made.occupancy)
    (tmp_path / "amcl.yaml").write_text(text)
    assert main(["one.npz", "one.yaml", "--params", "amcl.yaml", "--seeds", "2"]) == status
    assert capsys.readouterr().err == (f"localize_log.py: {told}\n" if told else "")


@pytest.mark.parametrize("yaw, told", [("90", "is 90 rad; if degrees are meant, write 1.5708"), ("-3.1", "")])
def test_a_start_that_is_turned_by_degrees_is_told(tmp_path, capsys, monkeypatch, yaw, told):
    """A filter set out 117 degrees off, and was called bad."""
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 5, Rough(beams=60), np.random.default_rng(1))
    save_log("one.npz", made.log)
    save_map("one", made.occupancy)
    place = map(str, made.log.reference[0, :2])
    assert main(["one.npz", "one.yaml", "--seeds", "2", "--start", *place, yaw]) == 0
    assert capsys.readouterr().err == (f"localize_log.py: the yaw of --start {told}\n" if told else "")


@pytest.mark.parametrize("times, told", [
    ([0.0, 0.2, 0.4, 0.0, 0.2], "1 of 5 times do not rise; the first is of scan 3, -0.4 s after the one before"),
    ([3.0] * 5, "4 of 5 times do not rise; the first is of scan 1, 0 s after the one before"),
    ([0.0, np.nan, 0.4, 0.6, 0.8], "2 of 5 times do not rise; the first is of scan 1, nan s after the one before"),
    ([0.0, 200.0, 400.0, 600.0, 900.0], "its scans are 200 s apart; times must be in seconds"),
    ([0.0, 0.2, 0.5, 0.7, 60.0], ""),
])
def test_times_by_which_no_jump_of_odometry_can_be_told_are_told(tmp_path, capsys, monkeypatch, times, told):
    """In milliseconds, or of two drives in one log, they left a filter metres off where odometry began anew."""
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 5, Rough(beams=60), np.random.default_rng(1))
    save_log("one.npz", replace(made.log, times=np.array(times)))
    save_map("one", made.occupancy)
    for more in [], ["--seeds", "2"]:
        assert main(["one.npz", "one.yaml", *more]) == 0
        assert capsys.readouterr().err == (
            f"localize_log.py: log one.npz: {told}; jumps of its odometry may be taken for driving\n" if told else "")


def test_a_log_on_two_maps_has_a_row_for_each_and_what_is_asked_for_twice_counts_once(tmp_path, monkeypatch):
    """Both maps went into one row by the log's name, half right, and which of them was the better was not to be seen.

    A stress that was given twice counted as twice as many trials, with an interval to match.
    """
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 12, Rough(beams=60), np.random.default_rng(1))
    save_log("one.npz", made.log)
    save_map("right", made.occupancy)
    save_map("bare", replace(made.occupancy, data=np.zeros_like(made.occupancy.data)))
    files = ["one.npz", "right.yaml", "one.npz", "bare.yaml", "one.npz", "right.yaml"]
    assert main([*files, "--stress", "every=2", "--stress", "every=2", "--out", "out"]) == 0
    rows = json.loads((tmp_path / "out" / "trials.json").read_text())
    assert [(row["log"], row["trials"]) for row in rows] == 2 * [
        ("one.npz on right.yaml", 1), ("one.npz on bare.yaml", 1), ("all", 2)]


def test_a_truth_that_is_not_known_everywhere_judges_where_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 8, Rough(), np.random.default_rng(1))
    made.log.reference[5] = np.nan
    save_log("log.npz", made.log)
    save_map("map", made.occupancy)
    assert main(["log.npz", "map.yaml", "--out", "out"]) == 0
    figures = json.loads((tmp_path / "out" / "result.json").read_text())
    assert figures["translation_error"]["max"] < 0.5 and figures["lost_share"] == 0.0


def test_a_log_or_a_map_that_says_nothing_is_an_error_and_no_result(tmp_path, capsys, monkeypatch):
    """A user who reads "error 2.1 m" looks for it in the filter."""
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 4, Rough(), np.random.default_rng(1))
    save_map("map", made.occupancy)
    save_map("unknown", replace(made.occupancy, data=np.full_like(made.occupancy.data, -1)))
    save_log("log.npz", made.log)
    save_log("nothing.npz", replace(made.log, odom=np.full((4, 3), np.nan)))
    for seeds in "1", "2":  # of several, a table had errors of a pose that stayed where it began
        assert main(["nothing.npz", "map.yaml", "--seeds", seeds]) == 1
        assert "none of the 4 scans of log nothing.npz could be used" in capsys.readouterr().err
    assert main(["log.npz", "unknown.yaml", "--global-localization"]) == 1
    assert "the map has no free cell" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, complaint",
    [
        (["log.npz"], "log.npz has no map"),
        (["map.yaml"], "there is no log"),
        (["log.npz", "map.yaml", "--stress", "rain=1"], "stress 'rain' is unknown; there are odometry, slips"),
        (["log.npz", "map.yaml", "--stress", "unmapped"], "stress 'unmapped' is not NAME=NUMBER"),
        (["log.npz", "map.yaml", "--stress", "unmapped=2"], "unmapped is 2.0"),
        (["none.npz", "map.yaml"], "none.npz"),
        (["log.npz", "none.yaml"], "none.yaml"),
        (["log.npz", "map.yaml", "--params", "bad.yaml"], "kld_err"),
    ],
)
def test_the_command_says_what_was_wrong(tmp_path, capsys, monkeypatch, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 3, Rough(), np.random.default_rng(1))
    save_log("log.npz", made.log)
    save_map("map", made.occupancy)
    (tmp_path / "bad.yaml").write_text("kld_err: -1\n")
    assert main(arguments) == 1
    printed = capsys.readouterr().err
    assert complaint in printed and printed.count("\n") == 1


def test_what_is_no_number_of_seeds_is_refused_with_the_usage_like_every_such_option(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["log.npz", "map.yaml", "--seeds", "0"])
    assert ended.value.code == 2 and "argument --seeds: 0 is below 1" in capsys.readouterr().err


def test_scans_of_which_nothing_could_be_used_are_counted(tmp_path, capsys, monkeypatch):
    """A third of a log without odometry read like a drive in which the filter had little to do."""
    monkeypatch.chdir(tmp_path)
    made = make_drive("hall", 9, Rough(), np.random.default_rng(1))
    made.log.odom[3:6] = np.nan
    save_log("log.npz", made.log)
    save_map("map", made.occupancy)
    assert main(["log.npz", "map.yaml", "--out", "out"]) == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["unusable"] == 3
    assert "nothing could be used of 3 scans" in capsys.readouterr().out


def test_the_help_has_each_sign_once(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "%%" not in capsys.readouterr().out
