"""Parameter files and changes to them."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402

from mbf_relay.lockstep.settings import (  # noqa: E402
    change,
    config_folder,
    flatten,
    full_name,
    load_own,
    load_settings,
    parse_change,
)
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import load_tasks  # noqa: E402

SETTINGS = {
    "simulator": {"time_step": 0.005},
    "move_base_flex": {
        "controller_frequency": 10.0,
        "DWA": {"sim_time": 1.5},
        "local_costmap": {"inflation": {"inflation_radius": 1.0}},
    },
}
KNOWN = list(flatten(SETTINGS)) + [
    "move_base_flex.DWA.vx_samples",
    "simulator.odometry.update_rate",
    "amcl.update_rate",
]


def test_names_are_dotted():
    assert "move_base_flex.local_costmap.inflation.inflation_radius" in list(flatten(SETTINGS))


@pytest.mark.parametrize(
    "text, value",
    [("a.b=1", 1), ("a.b=1.5", 1.5), ("a.b=true", True), ("a.b=x", "x"), ("a.b=[1, 2]", [1, 2]), ("a.b=c=d", "c=d")],
)
def test_values_are_yaml(text, value):
    assert parse_change(text) == ("a.b", value)


@pytest.mark.parametrize("text", ["", "a", "=1", "a=[1"])
def test_malformed_changes_are_refused(text):
    with pytest.raises(ValueError):
        parse_change(text)


def test_the_end_of_a_name_is_enough():
    assert full_name("sim_time", KNOWN) == "move_base_flex.DWA.sim_time"
    assert full_name("DWA.sim_time", KNOWN) == "move_base_flex.DWA.sim_time"


def test_what_of_a_robot_is_not_as_its_file_says_is_told(tmp_path):
    shape = '<geometry><box size="0.3 0.3 0.1"/></geometry>'
    wheel = """<joint name="{0}" type="continuous"><parent link="base_link"/><child link="{0}"/>
      <origin xyz="0 {1} 0" rpy="-1.57 0 0"/><axis xyz="0 0 1"/></joint><link name="{0}"><collision><geometry>
      <cylinder radius="0.05" length="0.02"/></geometry></collision></link>"""
    (tmp_path / "own.urdf").write_text(f"""<robot name="own"><link name="base_link"><collision>{shape}</collision>
      </link>{wheel.format("left", 0.15)}{wheel.format("right", -0.15)}<link name="scan"/>
      <joint name="up" type="fixed"><parent link="base_link"/><child link="scan"/><origin xyz="0 0 0.1"/></joint>
      <gazebo reference="scan"><sensor type="ray" name="s"><ray><scan><horizontal><samples>90</samples>
      <min_angle>-0.5</min_angle><max_angle>2.0</max_angle></horizontal></scan></ray></sensor></gazebo></robot>""")
    setup = make_setup(config_folder(), robot=str(tmp_path / "own.urdf"))
    assert setup.notes == (
        "robot 'own': its lidar looks from -0.50 to 2.00 rad; as far to both sides is simulated",)


def test_an_ambiguous_name_is_refused():
    with pytest.raises(ValueError, match="amcl.update_rate or simulator.odometry.update_rate"):
        full_name("update_rate", KNOWN)


@pytest.mark.parametrize(
    "name, nearest",
    [("DWA.simtime", "move_base_flex.DWA.sim_time"), ("inflation_radus", "inflation.inflation_radius"),
     ("move_base_flex.controler_frequency", "move_base_flex.controller_frequency")],
)
def test_an_unknown_name_is_answered_with_the_nearest(name, nearest):
    with pytest.raises(ValueError, match=f"no parameter '{name}'; did you mean '.*{nearest}'"):
        full_name(name, KNOWN)


def test_change_leaves_the_original_alone_and_makes_missing_groups():
    made = change(SETTINGS, ["sim_time=2.0", "vx_samples=5", "odometry.update_rate=30"], KNOWN)
    assert made["move_base_flex"]["DWA"] == {"sim_time": 2.0, "vx_samples": 5}
    assert made["simulator"]["odometry"] == {"update_rate": 30}
    assert SETTINGS["move_base_flex"]["DWA"] == {"sim_time": 1.5}


def test_missing_and_malformed_files_are_named(tmp_path):
    with pytest.raises(ValueError, match="simulator.yaml cannot be read"):
        load_settings(tmp_path)
    (tmp_path / "simulator.yaml").write_text("a: [1")
    with pytest.raises(ValueError, match="simulator.yaml is no YAML"):
        load_settings(tmp_path)
    (tmp_path / "simulator.yaml").write_text("3")
    with pytest.raises(ValueError, match="holds no parameters"):
        load_settings(tmp_path)


@pytest.mark.parametrize("text, words", [
    ("move_base_flex: {}\namcl: 3", "has 3 under 'amcl'; it must have names and values there"),
    ("move_base_flex: {}\nDWA: {}", "has 'DWA' at its first level"),
    ("3: {}\nDWA: {}", "has '3' at its first level"),
])
def test_what_is_wrong_at_a_file_s_first_level_is_named_and_nothing_else(tmp_path, text, words):
    """Told was the first name there, though it is a node's; and a number among the names showed a traceback."""
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(ValueError, match=re.escape(words)):
        load_own(tmp_path / "own.yaml")


def test_a_node_of_which_all_is_commented_out_has_no_parameters(tmp_path):
    (tmp_path / "own.yaml").write_text("amcl:\n  # min_particles: 3\nsimulator: {scan_noise: 0.1}\n")
    assert load_own(tmp_path / "own.yaml") == {"simulator": {"scan_noise": 0.1}}


@pytest.mark.parametrize("text, words", [
    ("planners: my_planners.StraightLine", "parameter planners is 'my_planners.StraightLine'; it must be a list"),
    ("planners: [{name: mine, typ: navfn/NavfnROS}]", "entry 0 of planners .* must have a name and a type"),
    ("planners: [{name: a, type: any_angle}, {name: a, type: navfn/NavfnROS}]", "planners names 'a' twice"),
    ("controllers: [{name: mine, type: mppi}]\n  mine: 3", "parameter mine is 3; it must be the group of plugin"),
    ("controllers: 3", "parameter controllers is 3"),
    ("global_costmap: 3", "global_costmap"),
    ("local_costmap: {plugins: [{name: mine, type: my_layers.Godo}]}", "local_costmap: layer 'mine': .*my_layers"),
])
def test_a_list_of_plugins_written_wrongly_is_refused_before_anything_is_driven(tmp_path, text, words):
    (tmp_path / "mine.yaml").write_text(f"move_base_flex:\n  {text}\n")
    for changes in ((), ("seed=3",)):
        with pytest.raises(ValueError, match=words):
            make_setup(config_folder(), changes=changes, config=tmp_path / "mine.yaml")


@pytest.mark.parametrize("change, options, why", [
    ("amcl.laser_sigma_hit=0.4", {"has_map": False}, "the pose comes from odometry, not from amcl"),
    ("amcl.tf_broadcast=false", {"has_map": False}, "the pose comes from odometry, not from amcl"),
    ("global_costmap.width=30", {"has_map": False}, "without a map"),
    ("DWAPlannerROS.sim_time=3.0", {"controller": "MPPI"}, "MPPI takes its place"),
    ("PurePursuit.lookahead_dist=0.5", {}, "DWAPlannerROS takes its place"),
])
def test_who_changes_what_nothing_reads_is_told_before_a_night_of_equal_drives(change, options, why):
    """compare.py named the parameter as what two batches differ in, and tune.py looked for the best of equal ones."""
    (note,) = make_setup(config_folder(), changes=[change], **options).notes
    assert change.partition("=")[0] in note and "has no effect" in note and why in note


@pytest.mark.parametrize("worlds, options, name, why", [
    ("free", {"changes": ["initial_pose_x=-0.3"], "prior_map": "known"}, "amcl.initial_pose_x", "the worlds say where"),
    ("free", {"map_resolution": 0.02, "prior_map": "none"}, "--map-resolution", "the robot has no map"),
    ("circle", {"map_resolution": 0.02}, "--map-resolution", "the worlds have maps of their own"),
    ("circle", {"changes": ["gyro_noise=0.1"]}, "simulator.gyro_noise", "listens to that sensor"),
    ("circle", {"changes": ["amcl.use_map_topic=true"]}, "amcl.use_map_topic", "it is of amcl as a node"),
    ("circle", {"changes": ["amcl.transform_tolerance=1"]}, "amcl.transform_tolerance", "it is of amcl as a node"),
])
def test_what_a_world_states_or_no_drive_needs_is_not_changed_in_vain_untold(tmp_path, worlds, options, name, why):
    """A study of a filter that starts wrongly began where the robot was, in each drive."""
    source = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE) if worlds == "free" else worlds
    (note,) = make_setup(config_folder(), tasks=load_tasks(source), **options).notes
    assert note.startswith(f"{name}: has no effect in these drives: ") and why in note


@pytest.mark.parametrize("change", ["initial_pose_x=here", "initial_cov_aa=-1", "initial_pose_a=.nan"])
def test_a_start_that_is_none_is_refused_and_not_another_one_taken(change):
    """The filter began at 0 in its place, or as sure of the pose as by default, and no line said so."""
    name = change.partition("=")[0]
    with pytest.raises(ValueError, match=f"parameter {name} is .*; it must be a finite number"):
        make_setup(config_folder(), changes=[change])


@pytest.mark.parametrize("worlds, options", [
    ("circle", {"changes": ["initial_pose_x=-0.3"]}),
    ("free", {"changes": ["initial_cov_xx=0.5"], "prior_map": "known", "map_resolution": 0.02}),
])
def test_where_no_world_states_it_the_parameter_counts(tmp_path, worlds, options):
    source = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE) if worlds == "free" else worlds
    assert not make_setup(config_folder(), tasks=load_tasks(source), **options).notes


@pytest.mark.parametrize(
    "change", ["amcl.laser_sigma_hit=0.4", "global_costmap.track_unknown_space=true", "sim_time=3.0"])
def test_of_what_is_read_nothing_is_said(change):
    assert not make_setup(config_folder(), changes=[change]).notes


def test_who_lets_another_robot_drive_by_a_parameter_alone_is_told_whose_footprint_it_has(tmp_path):
    """A waffle, half as wide again, passed boxes 2 cm away with the footprint of a burger; nobody was told."""
    file = tmp_path / "simulator.yaml"
    file.write_text("robot: waffle\n")
    for given in ({"changes": ["simulator.robot=waffle"]}, {"config": file}):
        (note,) = make_setup(config_folder(), **given).notes
        assert "waffle drives with the footprint of burger; --robot waffle" in note
    assert not make_setup(config_folder(), robot="waffle").notes
    assert not make_setup(config_folder(), changes=["simulator.robot=burger", "simulator.scan_noise=0.02"]).notes
    own = "local_costmap.footprint=[[-0.2, -0.2], [-0.2, 0.2], [0.1, 0.2], [0.1, -0.2]]"
    changes = ["simulator.robot=waffle", own, own.replace("local", "global")]
    assert not make_setup(config_folder(), changes=changes).notes


def test_parameters_of_drives_with_a_layer_in_another_s_place_can_be_changed(tmp_path):
    """A batch with any change ended with "unknown layer type", where without one it was driven."""
    layers = "[{name: seen, type: 'costmap_2d::FetchDepthLayer'}]"
    (tmp_path / "mine.yaml").write_text(
        f"move_base_flex: {{local_costmap: {{plugins: {layers}, seen: {{observation_sources: scan}}}}}}\n")
    setup = make_setup(config_folder(), changes=["seen.max_obstacle_height=1.5"], config=tmp_path / "mine.yaml")
    assert setup.settings["move_base_flex"]["local_costmap"]["seen"]["max_obstacle_height"] == 1.5


def test_who_drives_a_batch_with_a_speed_in_centimetres_is_told_as_the_server_tells(tmp_path):
    file = tmp_path / "move_base_flex.yaml"
    file.write_text("PurePursuit: {max_vel_x: 26.0, max_vel_trans: 26.0}\n")
    for given in ({"config": file}, {"changes": ["PurePursuit.max_vel_x=26.0", "PurePursuit.max_vel_trans=26.0"]}):
        notes = make_setup(config_folder(), **given).notes
        assert any("PurePursuit.max_vel_x: is 26.0; speeds are in m/s" in note for note in notes), notes
