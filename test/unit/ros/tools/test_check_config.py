"""What a human is told of parameter and launch files, with file and line, before a robot drives by them."""

import io
from pathlib import Path

import pytest

from mbf_relay.costmap.outline import parse_footprint, radii
from mbf_relay.costmap.outline_checks import first_crossing
from mbf_relay.ros.tools.check_config import main

REPOSITORY = Path(__file__).resolve().parents[4]
GOOD = """
base_local_planner: dwa_local_planner/DWAPlannerROS
local_costmap: {robot_radius: 0.2, global_frame: odom, rolling_window: true, observation_sources: scan, scan: {}}
global_costmap: {robot_radius: 0.2}
DWAPlannerROS:
  max_vel_x: 0.3
"""


def check(tmp_path, text, *options, name="params.yaml"):
    """Return exit status and what was told."""
    path = tmp_path / name
    path.write_text(text)
    out = io.StringIO()
    return main([str(path), *options], out), out.getvalue()


def test_a_sound_file_passes_and_what_drives_is_named(tmp_path):
    status, told = check(tmp_path, GOOD)
    assert status == 0 and "dwa_local_planner/DWAPlannerROS by DwaController" in told


def test_a_misspelt_name_is_told_with_its_line_and_fails_the_strict(tmp_path):
    text = GOOD + "  max_vel_xx: 0.4\n"
    status, told = check(tmp_path, text)
    assert status == 0 and "DWAPlannerROS/max_vel_xx" in told and "params.yaml:7]" in told
    assert check(tmp_path, text, "--strict")[0] == 1


@pytest.mark.parametrize("change, said, line", [
    ("  acc_lim_x: 0.0\n", "acc_lim_x is 0", ":7]"),
    ("  max_vel_x: 55.0\n", "m/s", ":7]"),
    ("  max_vel_theta: 90.0\n", "rad/s", ":7]"),
    ("  max_vel_trans: fast\n", "max_vel_trans is 'fast'", ":7]"),
    ("  sim_time: [1.0]\n", "sim_time is [1.0]", ":7]"),
    ("  max_vel_theta: 0.0\n", "never turn", ":7]"),
    ("  max_vel_trans: .inf\n", "max_vel_trans is inf; it must be within 1e+09 m/s of 0", ":7]"),
    ("  max_vel_theta: .inf\n", "max_vel_theta is inf; it must be within 1e+09 rad/s of 0", ":7]"),
])
def test_values_no_robot_could_mean_fail_with_value_and_line(tmp_path, change, said, line):
    status, told = check(tmp_path, GOOD + change)
    assert said in told and line in told, told
    assert status == 1


COSTMAPS = """
base_local_planner: dwa_local_planner/DWAPlannerROS
global_costmap:
  robot_radius: 0.2
  %s
local_costmap:
  robot_radius: 0.2
  global_frame: odom
  rolling_window: true
  observation_sources: scan
  scan:
    topic: scan
    %s
  inflation_layer:
    %s
  %s
"""


@pytest.mark.parametrize("lines, said, line", [
    (("width: -3.0", "", "", ""), "global_costmap: parameter width is -3.0; it must be above 0.0 m: 10.0 is used", 5),
    (("", "", "", "width: -3.0"), "local_costmap: parameter width is -3.0; it must be above 0.0 m: 10.0 is used", 16),
    (("", "", "", "inflation_radius: -1.0"), "layer 'inflation_layer': parameter inflation_radius is -1.0", 16),
    (("inflation_radius: 1.0", "", "inflation_radius: -1.0", ""), "'inflation_layer': parameter inflation_radius", 15),
    (("", "max_obstacle_height: 1.0e+12", "", ""), "observation source 'scan': parameter max_obstacle_height is", 13),
])
def test_what_a_costmap_changes_is_told_with_the_costmap_and_its_line(tmp_path, lines, said, line):
    """It was told without the costmap, and with the line its group begins in."""
    told = check(tmp_path, COSTMAPS % lines)[1]
    (about,) = [each for each in told.splitlines() if said in each]
    assert about.startswith("  changed: ") and about.endswith(f"params.yaml:{line}]"), told


def test_a_local_costmap_that_is_never_updated_is_doubted(tmp_path):
    status, told = check(tmp_path, GOOD.replace("rolling_window: true", "rolling_window: true, update_frequency: 0"))
    assert "local_costmap/update_frequency: is 0; nothing is driven by" in told and status == 1
    assert check(tmp_path, GOOD.replace("global_costmap: {", "global_costmap: {update_frequency: 0, "))[0] == 0


def test_a_robot_that_would_see_nothing_is_doubted(tmp_path):
    blind = "local_costmap/observation_sources: is not given, so that nothing is seen there"
    status, told = check(tmp_path, GOOD.replace("observation_sources: scan, ", ""))
    assert blind in told and status == 1
    layers = ("plugins: [{name: seen, type: 'costmap_2d::ObstacleLayer'}], seen: {scan: {topic: scan}}, "
              "observation_sources: scan, ")
    told = check(tmp_path, GOOD.replace("observation_sources: scan, ", layers))[1]
    assert "local_costmap/seen/observation_sources: is not given" in told  # costmap_2d reads the layer's group
    seeing = layers.replace("seen: {", "seen: {observation_sources: scan, ")
    told = check(tmp_path, GOOD.replace("observation_sources: scan, ", seeing) + "  max_vel_y: 0.0\n")[1]
    assert "is not given" not in told


@pytest.mark.parametrize("given, by", [("", "footprint"), ("footprint: [], robot_radius: 0.46, ", "robot_radius")])
def test_a_path_planned_for_a_smaller_robot_than_drives_it_is_doubted(tmp_path, given, by):
    told = check(tmp_path, GOOD.replace("local_costmap: {robot_radius: 0.2, ", "local_costmap: {" + given))[1]
    assert f"local_costmap/{by}: reaches 0.45 m" in told and "the global costmap's 0.20 m" in told, told


@pytest.mark.parametrize("footprint, said", [
    ("[[0.1, 0.2], [0.5, 0.2], [0.5, -0.2], [0.1, -0.2]]", "base frame's origin"),
    ("[[0.1, 0.2], [0.5, 0.2]]", "at least 3"),
    ("[[0.3, 0.0], [0.0, 0.0], [-0.3, 0.0]]", "encloses no area"),
])
def test_footprints_that_would_hurt_are_refused(tmp_path, footprint, said):
    status, told = check(tmp_path, GOOD.replace("robot_radius: 0.2, global", f"footprint: {footprint}, global"))
    assert status == 1 and "refused" in told and said in told and "params.yaml:3]" in told


def test_a_rectangle_whose_corners_are_told_row_by_row_is_driven_and_told_of(tmp_path):
    """Public robots have such a file, and C++'s move_base drives them."""
    rows = "[[0.3, 0.2], [-0.3, 0.2], [0.3, -0.2], [-0.3, -0.2]]"
    status, told = check(tmp_path, GOOD.replace("robot_radius: 0.2, global", f"footprint: {rows}, global"))
    assert status == 0 and "changed: " in told and "crosses itself" in told and "params.yaml:3]" in told
    assert sorted(parse_footprint(rows).tolist()) == [[-0.3, -0.2], [-0.3, 0.2], [0.3, -0.2], [0.3, 0.2]]
    assert first_crossing(parse_footprint(rows)) is None and radii(parse_footprint(rows))[0] == pytest.approx(0.2)


@pytest.mark.parametrize("old, new, said", [
    ("robot_radius: 0.2, global", "robot_radius: 0.0, global", "local_costmap/robot_radius: is 0.0, and there is no"),
    ("{robot_radius: 0.2}", "3", "refused: global_costmap: is 3"),
    ("{robot_radius: 0.2}", "{robot_radius: 0.2, inflation_radius: 0.05}",
     "global_costmap/inflation_radius: is 0.05 m"),
    ("{robot_radius: 0.2}", "{robot_radius: 0.2, inflation_layer: {inflation_radius: 0.0}}",
     "global_costmap/inflation_layer/inflation_radius: is 0 m"),
])
def test_a_robot_without_size_or_room_is_told(tmp_path, old, new, said):
    status, told = check(tmp_path, GOOD.replace(old, new))
    assert status == 1 and said in told and "not known here" not in told


def test_a_window_that_does_not_hold_the_robot_is_told_and_so_is_the_one_it_gets(tmp_path):
    status, told = check(tmp_path, GOOD.replace("rolling_window: true", "rolling_window: true, width: 0.3, height: 1"))
    assert status == 0 and "changed: local_costmap: parameters width and height are 0.3 m and 1 m" in told
    assert "0.43 m across, must be twice as wide: 0.86 m and 1.00 m are used" in told and "params.yaml:3]" in told


def test_of_a_name_that_stands_twice_both_lines_are_told(tmp_path):
    status, told = check(tmp_path, GOOD + "  max_vel_x: 0.2\n")
    assert status == 1 and "lines 6 and 7" in told


def test_of_what_overrides_a_group_that_is_merged_in_nothing_is_told(tmp_path):
    status, told = check(tmp_path, GOOD + "common: &common {a: 1, b: 2}\nother: {<<: *common, a: 3}\n")
    assert "twice" not in told


def test_a_turn_rate_in_degrees_is_read_as_rosparam_reads_it(tmp_path):
    status, told = check(tmp_path, GOOD + "  max_rot_vel: !degrees 60.0\n")
    assert "tag" not in told and status != 2, told


def test_a_file_in_another_encoding_is_told_with_its_line(tmp_path, capsys):
    (tmp_path / "params.yaml").write_bytes(b"# speeds\n# f\xfcr den Flur\n")
    assert main([str(tmp_path / "params.yaml")], io.StringIO()) == 2
    assert "params.yaml:2: byte 0xfc is no UTF-8" in capsys.readouterr().err


@pytest.mark.parametrize("text, said", [
    ("a:\n\tb: 1\n", "params.yaml:2: the line begins with a tab"),
    ("a: [1, 2\nb: 3\n", "params.yaml:2"),
    ("just words\n", "no names"),
])
def test_what_is_no_yaml_is_told_with_its_line(tmp_path, capsys, text, said):
    status, _ = check(tmp_path, text)
    assert status == 2 and said in capsys.readouterr().err


def test_a_launch_file_is_read_with_its_arguments_includes_and_namespaces(tmp_path):
    (tmp_path / "common.yaml").write_text("observation_sources: scan\nscan: {topic: scan}\nrobot: 1\n")
    (tmp_path / "inner.launch").write_text(f"""<launch><arg name="speed"/>
      <node pkg="move_base" type="move_base" name="move_base">
        <rosparam file="{tmp_path}/common.yaml" command="load" ns="local_costmap"/>
        <param name="DWAPlannerROS/max_vel_x" value="$(arg speed)" if="$(eval speed != '')"/>
        <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
        <param name="global_costmap/width" value="20"/>
      </node></launch>""")
    launch = f"""<launch><arg name="speed" default="0.3"/>
      <include file="{tmp_path}/inner.launch"><arg name="speed" value="$(arg speed)"/></include></launch>"""
    status, told = check(tmp_path, launch, name="outer.launch")
    assert status == 0 and "local_costmap/robot" in told and "common.yaml:3]" in told
    status, told = check(tmp_path, launch, "--arg", "speed:=70", name="outer.launch")
    assert status == 1 and "max_vel_x" in told and "inner.launch:4]" in told


LAUNCH_OF_A_SPEED = """<launch><arg name="speed" default="0.3"/>
  <node pkg="move_base" type="move_base" name="move_base">
    <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
    <param name="DWAPlannerROS/max_vel_x" value="$(arg speed)"/>
    <rosparam>{local_costmap: {observation_sources: scan, scan: {topic: scan}}, global_costmap: {width: 20}}</rosparam>
  </node></launch>"""


def test_arguments_of_a_launch_file_are_given_as_to_roslaunch(tmp_path):
    """They were taken for files and passed over: another robot was checked than the one that is launched."""
    assert check(tmp_path, LAUNCH_OF_A_SPEED, name="nav.launch")[0] == 0
    status, told = check(tmp_path, LAUNCH_OF_A_SPEED, "speed:=70", name="nav.launch")
    assert status == 1 and "max_vel_x: is 70" in told, told


def test_an_argument_that_the_launch_file_does_not_have_is_refused_as_roslaunch_does(tmp_path, capsys):
    """It was taken in silence: what was checked had the default, and the robot was launched with neither."""
    for given in (("--quiet", "sped:=70"), ("--arg", "sped:=70")):  # also after an option
        assert check(tmp_path, LAUNCH_OF_A_SPEED, *given, name="nav.launch")[0] == 2
        assert "'sped' is no argument of" in (said := capsys.readouterr().err) and "did you mean 'speed'?" in said


LAUNCH_OF_A_GROUP = """<launch><group ns="$(arg robot)"><arg name="speed" default="0.3"/>
  <rosparam ns="move_base/local_costmap">{robot_radius: 0.2}</rosparam>
  <param name="move_base/base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
  <param name="/second/move_base/DWAPlannerROS/max_vel_x" value="70"/>
  <include file="%s" ns="nav"/>
  <node pkg="move_base" type="move_base" name="move_base"/></group></launch>"""


def test_what_is_set_outside_of_a_node_is_the_node_s_within_its_namespace(tmp_path):
    """Of a robot in a group nothing was found that stood outside of the node, and it passed as one without size."""
    (tmp_path / "inner.launch").write_text("""<launch><param name="move_base/controler_frequency" value="1"/>
      <node pkg="move_base" type="move_base" name="move_base"/></launch>""")
    text = LAUNCH_OF_A_GROUP.replace("<launch>", '<launch><arg name="robot" default="first"/>') % (
        tmp_path / "inner.launch")
    _, told = check(tmp_path, text, name="nav.launch")
    inner, outer = told.split("first/move_base (move_base)")
    assert inner.startswith("first/nav/move_base (move_base)")
    assert "controler_frequency" in inner and "controler_frequency" not in outer
    assert "DWAPlannerROS" in outer and "max_vel_x: is 70" not in told, told
    _, told = check(tmp_path, text, "robot:=second", name="nav.launch")
    assert "max_vel_x: is 70" in told.split("second/move_base (move_base)")[1]


@pytest.mark.parametrize("text, name, more, said", [
    (LAUNCH_OF_A_SPEED, "nav.launch", "more.yaml", "'more.yaml' is no launch file"),
    (GOOD, "params.yaml", "speed:=70", "'speed:=70' is an argument of a launch file, and no launch file is named"),
])
def test_what_would_not_be_read_is_refused(tmp_path, capsys, text, name, more, said):
    assert check(tmp_path, text, more, name=name)[0] == 2
    assert said in capsys.readouterr().err


def test_what_stands_in_a_launch_file_itself_is_told_with_that_file_s_line(tmp_path):
    inside = "<rosparam>\n      DWAPlannerROS:\n        max_vel_xx: 0.4\n    </rosparam>"
    text = f"""<launch>
  <node pkg="mbf_relay" type="move_base" name="move_base">
    <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
    {inside}
    <rosparam ns="local_costmap">{{robot_radius: 0.2, observation_sources: scan, scan: {{topic: scan}}}}</rosparam>
    {inside.replace("max_vel_xx", "<!-- not yet -->max_vel_yy")}
  </node>
</launch>"""
    _status, told = check(tmp_path, text, name="nav.launch")
    assert "max_vel_xx: is not known here; did you mean 'max_vel_x'?  [" in told and "nav.launch:6]" in told
    assert "nav.launch:11]" in told.split("max_vel_yy")[1].split("\n")[0]


OVERRIDES_BEHIND = """<launch><arg name="overrides" default=""/><arg name="guard" default="0"/>
  <node pkg="mbf_relay" type="move_base" name="move_base">
    <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
    <param name="DWAPlannerROS/max_vel_x" value="0.2" unless="$(arg guard)"/>
    <rosparam>{local_costmap: {observation_sources: scan, scan: {topic: scan}}, global_costmap: {width: 20}}</rosparam>
  </node>
  <rosparam command="load" file="$(arg overrides)" unless="$(eval overrides == '')"/></launch>"""


def test_what_is_set_behind_a_node_holds_as_it_does_under_roslaunch(tmp_path):
    """The launch files' own `overrides` were not read: whatever stood in them passed, and the robot did not start."""
    overrides = tmp_path / "mine.yaml"
    overrides.write_text("move_base:\n  controler_frequency: 5\n  DWAPlannerROS:\n    max_vel_x: 70\n")
    assert check(tmp_path, OVERRIDES_BEHIND, name="nav.launch")[0] == 0
    status, told = check(tmp_path, OVERRIDES_BEHIND, f"overrides:={overrides}", name="nav.launch")
    assert status == 1 and "max_vel_x: is 70" in told and "mine.yaml:4]" in told, told
    assert "controler_frequency" in told


@pytest.mark.parametrize("text", [None, "move_base:\n\tcontroller_frequency: 5\n"])
def test_a_file_that_may_hold_the_servers_parameters_has_to_be_there_and_sound(tmp_path, capsys, text):
    """It passed, and roslaunch started nothing."""
    if text is not None:
        (tmp_path / "mine.yaml").write_text(text)
    assert check(tmp_path, OVERRIDES_BEHIND, f"overrides:={tmp_path}/mine.yaml", name="nav.launch")[0] == 2
    assert "mine.yaml" in capsys.readouterr().err


def test_an_included_file_is_given_only_arguments_that_it_has_as_by_roslaunch(tmp_path, capsys):
    """A misspelt one was passed over and the check green, and roslaunch started nothing."""
    (tmp_path / "inner.launch").write_text(LAUNCH_OF_A_SPEED)
    text = f"""<launch><include file="{tmp_path}/inner.launch">
      <arg name="sped" value="70"/><arg name="spied" value="1" if="0"/></include></launch>"""
    assert check(tmp_path, text, name="nav.launch")[0] == 2
    assert "'sped' is no argument of" in (said := capsys.readouterr().err) and "did you mean 'speed'?" in said
    status, told = check(tmp_path, text.replace("sped", "speed"), name="nav.launch")
    assert status == 1 and "max_vel_x: is 70" in told
    status, _ = check(tmp_path, text.replace('inner.launch"', 'inner.launch" pass_all_args="true"'), name="nav.launch")
    assert status == 0


def test_a_server_that_is_forked_beside_other_nodes_is_examined(tmp_path):
    """With `composed:=true`, as a robot's own computer runs it, no server was found."""
    text = """<launch><group ns="robot">
      <rosparam ns="nav">{controler_frequency: 5, planners: [{name: a, type: navfn/NavfnROS}]}</rosparam>
      <node pkg="mbf_relay" type="compose" name="navigation"
       args="--no-respawn -- map_server &quot;a floor.yaml&quot; -- move_base_flex __name:=nav -- move_base_relay --"/>
    </group></launch>"""
    _, told = check(tmp_path, text, name="nav.launch")
    assert told.startswith("robot/nav (move_base_flex)") and "controler_frequency" in told


def test_a_condition_that_is_neither_true_nor_false_is_refused_as_roslaunch_does(tmp_path, capsys):
    assert check(tmp_path, OVERRIDES_BEHIND, "guard:=yes", name="nav.launch")[0] == 2
    assert "nav.launch: 'yes' is neither true nor false" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["pi.yaml", "lds.yaml"])
def test_whoever_gives_our_overrides_is_told_of_no_name_that_nobody_reads(name):
    files = REPOSITORY / "config" / name, REPOSITORY / "launch" / "navigation.launch"
    out = io.StringIO()
    assert main([str(files[1]), f"overrides:={files[0]}", "guard:=true", "--strict"], out) == 0, out.getvalue()


def test_a_file_of_overrides_is_not_said_to_be_without_effect_but_what_it_is_to_be_checked_with(tmp_path, capsys):
    text = "amcl: {max_particles: 500}\nmove_base_flex: {planners: [{name: straight, type: mine.StraightLine}]}\n"
    assert check(tmp_path, text) == (2, "")
    assert f"demo.launch overrides:={tmp_path / 'params.yaml'}" in capsys.readouterr().err


def test_a_launch_file_without_a_server_is_told(tmp_path, capsys):
    assert check(tmp_path, "<launch/>", name="none.launch")[0] == 2
    assert "no node of type move_base" in capsys.readouterr().err


NODE = """<node pkg="move_base" type="move_base" name="move_base">
  <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
  <rosparam file="$(find laptop_robot)/config/common.yaml" command="load" ns="local_costmap"/>
  <param name="global_costmap/width" value="20"/>
</node>"""


@pytest.fixture
def checkout(tmp_path):
    """Return a robot's repository, cloned where it is in no ROS package path: two packages beside each other."""
    for name in ("laptop_robot", "laptop_robot_launch"):
        (tmp_path / name / "config").mkdir(parents=True)
        (tmp_path / name / "package.xml").write_text(
            f"<package format='2'><name>{name}</name><version>1.0.0</version><description>-</description>"
            "<maintainer email='a@b.c'>-</maintainer><license>BSD</license></package>")
    (tmp_path / "laptop_robot" / "config" / "common.yaml").write_text(
        "robot: 1\nobservation_sources: scan\nscan: {topic: scan}\n")
    return tmp_path / "laptop_robot_launch"


def test_a_robots_repository_is_read_on_a_laptop_without_a_workspace(checkout):
    status, told = check(checkout, f"<launch>{NODE}</launch>", name="nav.launch")
    assert status == 0 and "local_costmap/robot" in told and "common.yaml:1]" in told


def test_what_no_server_needs_may_lie_in_packages_that_are_not_here(checkout):
    status, told = check(checkout, f"""<launch>
      <arg name="map_file" default="$(find maps_at_work)/floor.yaml"/>
      <node pkg="map_server" type="map_server" name="map_server" args="$(arg map_file)"/>
      <rosparam file="$(find arm_at_work)/limits.yaml" command="load" ns="arm"/>
      <include file="$(find drivers_at_work)/base.launch"><arg name="map_file" value="$(arg map_file)"/></include>
      <include file="$(find laptop_robot)/localization.launch"/>
      {NODE}</launch>""", name="nav.launch")
    assert status == 0 and "local_costmap/robot" in told
    assert "not read: $(find drivers_at_work)/base.launch: there is no package drivers_at_work" in told
    assert "laptop_robot/localization.launch: there is no such file" in told
    assert "maps_at_work" not in told and "arm_at_work" not in told


@pytest.mark.parametrize("line, said", [
    ('<rosparam file="$(arg files)/a.yaml" command="load"/>', "argument files has no value; give --arg files:=VALUE"),
    ('<param name="speed" value="$(arg far)"/>', "there is no package maps_at_work"),
    ('<rosparam file="$(find maps_at_work)/a.yaml" command="load"/>', "there is no package maps_at_work"),
    ('<param name="speed" value="$(find)"/>', "nav.launch: '$(find)' cannot be resolved"),
])
@pytest.mark.parametrize("outside", [False, True])
def test_what_the_server_needs_and_is_not_here_is_named(checkout, capsys, line, said, outside):
    above, within = (f'<group ns="move_base">{line}</group>', "") if outside else ("", line)
    launch = f"""<launch><arg name="files"/><arg name="far" default="$(find maps_at_work)/a.yaml"/>
      {above}{NODE.replace("</node>", within + "</node>")}</launch>"""
    assert check(checkout, launch, name="nav.launch")[0] == 2
    assert said in capsys.readouterr().err
