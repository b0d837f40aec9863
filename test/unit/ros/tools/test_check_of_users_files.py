"""What a human is told of a robot's own repository: every word true, and each with the line it is about."""

import io

import pytest
from roslaunch.config import load_config_default

from mbf_relay.ros.tools.check_config import main
from mbf_relay.ros.tools.parameter_source import ParameterSource, read_launch

COSTMAPS = """
local_costmap: {robot_radius: 0.2, rolling_window: true, observation_sources: scan, scan: {topic: scan}}
global_costmap: {robot_radius: 0.2}
"""
NODE = """<launch>
  <node pkg="move_base" type="move_base" name="move_base">
    <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
    <rosparam ns="local_costmap">{robot_radius: 0.2, observation_sources: scan, scan: {topic: scan}}</rosparam>
    <param name="global_costmap/robot_radius" value="0.2"/>
    %s
  </node>
</launch>"""


def check(tmp_path, text, *options, name="params.yaml"):
    """Return exit status and what was told."""
    path = tmp_path / name
    path.write_text(text)
    out = io.StringIO()
    return main([str(path), *options], out), out.getvalue()


def line_about(told, name):
    return next(line for line in told.splitlines() if name in line)


def test_a_parameter_of_a_launch_file_is_told_with_its_line(tmp_path):
    """The file alone was named, and there are hundreds of lines in some."""
    one = '<param\n      name="controler_frequency" value="5"/>'
    _, told = check(tmp_path, NODE % one + "<!-- é -->", name="nav.launch")
    assert line_about(told, "controler_frequency").endswith("nav.launch:6]")
    _, told = check(tmp_path, NODE % '\n<rosparam param="controler_frequency">5</rosparam>', name="nav.launch")
    assert line_about(told, "controler_frequency").endswith("nav.launch:7]")


def test_a_value_under_an_old_name_is_told_by_that_name_and_with_its_line(tmp_path):
    """It was told by the present name, which stands nowhere in the file, and with the line of the group."""
    planner = "base_local_planner: dwa_local_planner/DWAPlannerROS\nDWAPlannerROS:\n  sim_time: 1.5\n"
    _, told = check(tmp_path, COSTMAPS + planner + "  min_rot_vel: -0.3\n")
    assert "parameter min_rot_vel is -0.3; it must be at least 0.0 rad/s: 0.0 is used" in told
    assert line_about(told, "min_rot_vel is -0.3;").endswith("params.yaml:7]")
    status, told = check(tmp_path, COSTMAPS + planner + "  max_rot_vel: fast\n")
    assert status == 1 and "max_rot_vel is 'fast'" in told and "params.yaml:7]" in told
    _, told = check(tmp_path, COSTMAPS + planner + "  min_trans_vel: 0.4\n  max_trans_vel: 0.3\n")
    assert "parameter min_trans_vel is 0.4; it must be at most max_trans_vel: 0.3 is used" in told, told


def test_an_adapter_s_group_that_names_the_planner_is_read_and_not_called_ignored(tmp_path):
    _, told = check(tmp_path, COSTMAPS + """
base_local_planner: nav_core_adapter::LocalPlannerAdapter
LocalPlannerAdapter: {planner_name: 'dwb_local_planner::DWBLocalPlanner'}
""")
    assert "dwb_local_planner/DWBLocalPlanner" in told
    assert "LocalPlannerAdapter" not in told, told


def test_a_neighbour_that_is_no_package_hides_none_of_the_others(tmp_path):
    """One package.xml that was cut off, anywhere in the repository, ended the command in a traceback."""
    (tmp_path / ".git").mkdir()
    for name, text in (("a_broken_one", "<package><name>a_br"), ("b_nameless", "<package/>"),
                       ("robot", "<package><name> robot </name></package>")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "package.xml").write_text(text)
    (tmp_path / "old_robot").mkdir()
    (tmp_path / "old_robot" / "manifest.xml").write_text("<package/>")
    for name in ("robot", "old_robot"):
        (tmp_path / name / "speeds.yaml").write_text("controler_frequency: 5\n")
        one = f'<rosparam file="$(find {name})/speeds.yaml"/>'
        status, told = check(tmp_path, NODE % one, name="nav.launch")
        assert status == 0 and line_about(told, "controler_frequency").endswith(f"{name}/speeds.yaml:1]")


def test_a_package_is_read_where_it_is_written_not_where_the_workspace_installs_it(tmp_path):
    """A workspace that is a repository has what was installed of its packages once, without the files made since."""
    (tmp_path / ".git").mkdir()
    for folder in ("install/share/robot", "src/robot"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "package.xml").write_text("<package><name>robot</name></package>")
    (tmp_path / "install" / ".catkin").write_text("")
    (tmp_path / "src" / "robot" / "speeds.yaml").write_text("controler_frequency: 5\n")
    status, told = check(tmp_path, NODE % '<rosparam file="$(find robot)/speeds.yaml"/>', name="src/robot/nav.launch")
    assert status == 0 and line_about(told, "controler_frequency").endswith("src/robot/speeds.yaml:1]")


def test_of_two_sizes_of_robot_the_outline_in_use_is_told_where_a_footprint_stands_above_a_radius(tmp_path):
    """costmap_2d searches the parent namespaces for a footprint before it looks for a radius; the radius was named."""
    footprint = "footprint: [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]\n"
    costmaps = COSTMAPS.replace("global_costmap: {", "global_costmap: {footprint: [], ")
    _, told = check(tmp_path, costmaps + footprint)
    assert "doubtful: footprint: reaches 0.50 m" in told, told
    assert "robot_radius: reaches" not in told


@pytest.mark.parametrize("group", ["", "  scan: {topic: front_scan, data_type: LaserScan}\n"])
def test_a_sensor_of_which_only_the_name_is_told_is_doubted(tmp_path, group):
    """It is a point cloud on a topic of that name, which nobody publishes: the robot saw nothing, and nobody was told.
    """
    text = """
local_costmap: {robot_radius: 0.2, observation_sources: scan laser, scan: {topic: scan}}
global_costmap:
  robot_radius: 0.2
  plugins: [{name: obstacles, type: "costmap_2d::ObstacleLayer"}]
  obstacles: {observation_sources: scan}
"""
    status, told = check(tmp_path, text + group)
    assert status == 1
    assert "local_costmap/laser: is not given, so that source 'laser' is a PointCloud on topic 'laser'" in told
    in_global = line_about(told, "global_costmap/obstacles/scan")
    assert "source 'scan' is a PointCloud on topic 'scan'" in in_global
    assert ("the costmap's own group of that name is not read" in in_global) == bool(group)
    assert "local_costmap/scan" not in told


def test_of_a_robot_that_is_smaller_for_its_controller_the_radius_is_told_with_its_line(tmp_path):
    """The footprint was named, which is not there, with the line in which the costmap begins."""
    costmap = "local_costmap:\n  width: 3\n  robot_radius: 0.01\n  observation_sources: scan\n  scan: {topic: scan}\n"
    _, told = check(tmp_path, costmap + "global_costmap: {robot_radius: 0.2}\n")
    assert line_about(told, "local_costmap/robot_radius: reaches 0.01 m").endswith("params.yaml:3]")
    _, told = check(tmp_path, costmap.replace("  robot_radius: 0.01\n", "") + "\nrobot_radius: 0.01\n"
                    "global_costmap: {robot_radius: 0.2}\n")
    assert line_about(told, "robot_radius: reaches 0.01 m").endswith("params.yaml:6]")


def test_of_a_file_that_is_not_there_is_told_who_loads_it(tmp_path, capsys):
    """The file alone was named, in the words of the operating system, of launch files that include each other."""
    (tmp_path / "inner.launch").write_text(NODE % f'<rosparam file="{tmp_path}/gone.yaml"/>')
    text = f'<launch><include file="{tmp_path}/inner.launch"/></launch>'
    assert check(tmp_path, text, name="nav.launch")[0] == 2
    told = capsys.readouterr().err
    assert "gone.yaml: there is no such file; " in told and "inner.launch:6 loads it" in told


def test_of_an_open_quotation_in_a_node_s_arguments_is_told_where_it_is(tmp_path, capsys):
    """It ended in "No closing quotation", of launch files that include each other."""
    node = """<launch>
      <node pkg="mbf_relay" type="compose" name="all" args="-- amcl __name:='amcl"/>
    </launch>"""
    assert check(tmp_path, node, name="nav.launch")[0] == 2
    assert """nav.launch:2: args="-- amcl __name:='amcl": No closing quotation""" in capsys.readouterr().err


def test_what_compose_gives_to_all_its_nodes_is_told_of_with_each_of_them(tmp_path):
    """Wrong values after its last "--" were passed over."""
    node = """<launch>
      <node pkg="mbf_relay" type="compose" name="all"
       args="-- amcl __name:=front -- move_base_flex -- _tf_timeout:=-1 _update_min_d:=-2 scan:=front_scan"/>
    </launch>"""
    _, told = check(tmp_path, node, name="nav.launch")
    for word in ("front (amcl)", "parameter update_min_d is -2.0", "move_base_flex (", "parameter tf_timeout is -1"):
        assert word in told


AMCL = """<launch>
  <node pkg="amcl" type="amcl" name="amcl">
    <rosparam>
      laser_max_beans: 30
      initial_pose_x: 1.0
      update_min_d: -1
    </rosparam>
    %s
  </node>
</launch>"""


def test_of_amcl_s_parameters_is_told_as_of_move_base_s(tmp_path):
    """A launch file with amcl alone was refused, and beside move_base nothing was told of it."""
    status, told = check(tmp_path, AMCL % '<param name="laser_z_hit" value="much"/>', name="amcl.launch")
    assert status == 1 and told.startswith("amcl (amcl)")
    assert "laser_max_beans: is not known here; did you mean 'laser_max_beams'?" in told and "amcl.launch:4]" in told
    assert "refused: parameter laser_z_hit is 'much'" in told and "amcl.launch:8]" in told
    status, told = check(tmp_path, AMCL % "", name="amcl.launch")
    assert status == 0 and line_about(told, "update_min_d is").endswith("amcl.launch:6]")
    assert "used: initial_pose_x: 1.0" in told


def test_amcl_s_file_below_its_own_name_once_more_is_told_to_be_ignored(tmp_path):
    """It happens where a file that begins with `amcl:` is loaded inside of the node."""
    _, told = check(tmp_path, AMCL % "<rosparam>amcl: {min_particles: 500}</rosparam>", name="amcl.launch")
    assert "ignored: amcl: is not known here" in told and "amcl.launch:8]" in told


def test_amcl_s_yaml_file_alone_is_taken_for_amcl_s(tmp_path):
    status, told = check(tmp_path, "min_particles: 500\nodom_model_type: diff\nlaser_max_beans: 30\n")
    assert status == 0 and told.startswith("the files (amcl)") and "laser_max_beans" in told


def test_of_a_server_is_told_where_amcl_s_file_is_not_here(tmp_path):
    amcl = '<node pkg="amcl" type="amcl" name="amcl"><rosparam file="$(find at_work)/amcl.yaml"/></node>'
    text = NODE.replace("<launch>", f"<launch>{amcl}") % '<param name="controler_frequency" value="5"/>'
    status, told = check(tmp_path, text, name="nav.launch")
    assert status == 0 and "controler_frequency" in told
    assert "not read: $(find at_work)/amcl.yaml: there is no package at_work" in told and "(amcl)" not in told


WRITTEN = [
    "", "1", "1.0", "1e-3", "010", "1_000", "true", "True", "yes", "null", "~", "[1, 2]", "{a: 1}", " 5 ", "0x10",
]


def test_a_value_is_what_roslaunch_makes_of_it(tmp_path):
    """An empty one was none, a list a list, and `yes` true, where the robot got texts."""
    path = tmp_path / "nav.launch"
    typed = [("bool", "1"), ("int", " 5 "), ("double", "1"), *((kind, value) for kind in ("str", "yaml")
                                                              for value in WRITTEN)]
    lines = [f'<param name="auto{i}" value="{value}"/>' for i, value in enumerate(WRITTEN)]
    lines += [f'<param name="typed{i}" value="{value}" type="{kind}"/>' for i, (kind, value) in enumerate(typed)]
    path.write_text(NODE % "\n".join(lines))
    loaded = load_config_default([(str(path), [])], 11311, verbose=False).params
    source = ParameterSource()
    for full, parameter in loaded.items():
        if full.startswith("/move_base/"):
            source.put(full[len("/move_base/"):], parameter.value, "")
    (node,) = read_launch(str(path), {}).nodes
    for name, wanted in source.values.items():
        made = node.source.values[name]
        assert (made, type(made)) == (wanted, type(wanted)), name


def test_a_name_that_begins_with_a_tilde_within_its_node_is_the_node_s(tmp_path):
    """It was told to be unknown, with the advice to write what stands there."""
    text = NODE % '<param name="~oscillation_timeout" value="5"/><rosparam param="~planner_patience">7</rosparam>'
    _, told = check(tmp_path, text, name="nav.launch")
    assert "~" not in told
    (node,) = read_launch(str(tmp_path / "nav.launch"), {}).nodes
    assert node.source.values["oscillation_timeout"] == 5 and node.source.values["planner_patience"] == 7


def test_a_value_that_roslaunch_refuses_is_refused_with_its_line(tmp_path, capsys):
    assert check(tmp_path, NODE % '<param name="a" value="yes" type="bool"/>', name="nav.launch")[0] == 2
    assert "nav.launch:6: roslaunch refuses 'yes'" in capsys.readouterr().err


@pytest.mark.parametrize("wanted, status", [("0.3", 0), ("$(arg speed)", 2)])
@pytest.mark.parametrize("expression", ["model.split('_')[1]", "1.0 / int(model or 0)", "{}[model]", "0.1 +"])
def test_an_expression_that_python_cannot_evaluate_is_told_where_its_value_is_wanted(
        tmp_path, capsys, expression, wanted, status):
    """It ended in Python's words, without file or text, also where nothing of a server came of it."""
    text = f"""<launch><arg name="model" default=""/><arg name="speed" default="$(eval {expression})"/>
      <node pkg="move_base" type="move_base" name="move_base">
        <rosparam>
          {{local_costmap: {{observation_sources: scan, scan: {{topic: scan}}}}, global_costmap: {{width: 20}}}}
        </rosparam>
        <param name="TrajectoryPlannerROS/max_vel_x" value="{wanted}"/>
      </node></launch>"""
    assert check(tmp_path, text, name="nav.launch")[0] == status
    said = capsys.readouterr().err
    assert (f"$(eval {expression})" in said and "nav.launch" in said) == bool(status), said


@pytest.mark.parametrize("seeing", ["costmap_2d::ObstacleLayer", "range_sensor_layer::RangeSensorLayer"])
@pytest.mark.parametrize("order, doubted", [
    (("inflated", "seen"), True), (("seen", "inflated"), False), (("inflated", "seen", "inflated_too"), False),
    (("seen",), False),
])
def test_a_robot_led_right_beside_what_it_sees_is_doubted(tmp_path, order, doubted, seeing):
    """A public quadruped's files list the inflation first, others sonars last; costmap_2d inflates in that order."""
    types = {"seen": seeing, "inflated": "costmap_2d::InflationLayer", "inflated_too": "costmap_2d::InflationLayer"}
    listed = ", ".join(f"{{name: {name}, type: '{types[name]}'}}" for name in order)
    layers = f"plugins: [{listed}], seen: {{observation_sources: scan, scan: {{topic: scan}}}}, "
    status, told = check(tmp_path, COSTMAPS.replace("observation_sources: scan, ", layers))
    assert ("doubtful: local_costmap/plugins: lists 'seen' after 'inflated', which inflates only" in told) == doubted
    assert status == int(doubted), told


@pytest.mark.parametrize("layers, doubted", [
    ("{name: inflation, type: 'costmap_2d::InflationLayer'}", True),
    ("{name: seen, type: 'costmap_2d::ObstacleLayer'}, {name: inflation, type: 'costmap_2d::InflationLayer'}", False),
    ("{name: sonar, type: 'range_sensor_layer::RangeSensorLayer'}", False),
    ("{name: theirs, type: 'their_layers::DepthLayer'}", False),
    ("{name: map_layer, type: 'costmap_2d::StaticLayer'}", True),
    ("{name: octomap, type: 'costmap_2d::StaticLayer'}", False),
    ("", True),
])
def test_a_robot_whose_layers_all_see_nothing_is_not_called_sound(tmp_path, layers, doubted):
    """Who added one layer of his own had replaced those that see, and drove into a wall with exit status 0."""
    group = (f"plugins: [{layers}], seen: {{observation_sources: scan, scan: {{topic: scan}}}}, "
             "map_layer: {map_topic: /map}, octomap: {map_topic: /projected_map}, ")
    _, told = check(tmp_path, COSTMAPS.replace("rolling_window: true, ", "rolling_window: true, " + group))
    assert ("local_costmap/plugins: lists no layer that takes what a sensor sees, so that nothing" in told) == doubted


def test_a_robot_whose_obstacle_layer_is_switched_off_is_not_called_sound(tmp_path):
    switched_off = "rolling_window: true, obstacle_layer: {enabled: false}, "
    status, told = check(tmp_path, COSTMAPS.replace("rolling_window: true, ", switched_off))
    assert status == 1
    assert "local_costmap/obstacle_layer/enabled: is False, so that nothing is seen there" in told, told
    listed = "plugins: [{name: a, type: 'costmap_2d::ObstacleLayer'}, {name: b, type: 'costmap_2d::VoxelLayer'}], "
    groups = "a: {enabled: %s, observation_sources: s, s: {topic: s}}, b: {enabled: false, observation_sources: s}, "
    for other, doubted in (("false", True), ("true", False)):
        layers = f"rolling_window: true, {listed}{groups % other}"
        _, told = check(tmp_path, COSTMAPS.replace("rolling_window: true, ", layers))
        assert ("enabled: is False, so that nothing is seen there" in told) == doubted, told


def test_a_layer_behind_the_inflation_that_only_clears_is_not_doubted(tmp_path):
    """What marks nothing has nothing to be inflated."""
    layers = ("plugins: [{name: seen, type: 'costmap_2d::ObstacleLayer'}, {name: grown, type: "
              "'costmap_2d::InflationLayer'}, {name: freed, type: 'costmap_2d::ObstacleLayer'}], "
              "seen: {observation_sources: scan, scan: {topic: scan}}, "
              "freed: {observation_sources: scan, scan: {topic: scan, marking: false, clearing: true}}, ")
    status, told = check(tmp_path, COSTMAPS.replace("observation_sources: scan, ", layers))
    assert status == 0 and "after 'grown'" not in told, told


@pytest.mark.parametrize("critics, doubted", [
    ("[path, goal]", True), ("[mbf_relay.control.critics.motion.Slow]", True), ("[path, obstacle]", False),
    ("[mbf_relay.control.critics.obstacle.ObstacleCost, path]", False), ("[]", False), ("[ObstacleCritic]", False),
    ("[misspelt, path]", False), ("3", False),
])
def test_a_robot_whose_critics_let_it_touch_things_is_not_called_sound(tmp_path, critics, doubted):
    """Who added one critic of his own had replaced the one of obstacles."""
    chosen = f"base_local_planner: dwa_local_planner/DWAPlannerROS\nDWAPlannerROS: {{critics: {critics}}}\n"
    _, told = check(tmp_path, COSTMAPS + chosen)
    assert ("doubtful: DWAPlannerROS/critics: lists no 'obstacle'" in told) == doubted, told


GROUPED = NODE.replace("<launch>", "<launch><group ns='robot1'>\n<param name='tf_prefix' value='/robot1'/>").replace(
    "</launch>", "<node pkg='amcl' type='amcl' name='amcl'><param name='base_frame_id' value='%s'/></node>\n"
    "</group></launch>")


@pytest.mark.parametrize("frame, doubted", [("base_link", True), ("robot1/base_link", False)])
def test_who_counts_on_a_tf_prefix_is_told_before_the_robot_waits_for_frames(tmp_path, frame, doubted):
    """All was said to be used, and neither node ever found a transform."""
    given = f'<param name="global_costmap/robot_base_frame" value="{frame}"/>'
    status, told = check(tmp_path, GROUPED % (given, frame), name="nav.launch")
    told_of = [line for line in told.splitlines() if "tf_prefix is 'robot1'" in line]
    assert (status, len(told_of)) == ((1, 2) if doubted else (0, 0)), told
    assert all("parameter /robot1/tf_prefix" in line and line.endswith("nav.launch:2]") for line in told_of)


@pytest.mark.parametrize("place", ["other/tf_prefix", "robot1/move_base/local_costmap/tf_prefix"])
def test_a_tf_prefix_that_the_node_does_not_find_is_none_of_its_doubts(tmp_path, place):
    text = (GROUPED % ("", "base_link")).replace("name='tf_prefix'", f"name='/{place}'")
    assert "and is ignored, as by every node that uses tf2" not in check(tmp_path, text, name="nav.launch")[1]


def test_parameters_on_a_node_s_command_line_are_read_as_the_node_does(tmp_path):
    """The planner named there was not known, and its whole group was called ignored."""
    text = (NODE % "<rosparam>DWAPlannerROS: {max_vel_x: 0.3}</rosparam>").replace(
        '<param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>', "").replace(
        'name="move_base">', 'name="move_base" args="cmd_vel:=/wheels '
        '_base_local_planner:=dwa_local_planner/DWAPlannerROS _DWAPlannerROS/max_vel_theta:=much __log:=nav.log">')
    status, told = check(tmp_path, text, name="nav.launch")
    assert status == 1 and "max_vel_theta is 'much'" in told and "nav.launch:2]" in told, told
    text = text.replace("much", "1.0")
    assert "ignored" not in check(tmp_path, text, name="nav.launch")[1]
    amcl = '<launch><node pkg="amcl" type="amcl" name="amcl" args="scan:=front _odom_frame:=odom"/></launch>'
    assert line_about(check(tmp_path, amcl, name="nav.launch")[1], "odom_frame").endswith("nav.launch:1]")
