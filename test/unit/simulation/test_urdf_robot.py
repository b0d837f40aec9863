"""Robots by their URDF: what is read of it, what is refused, and that they drive as their wheels allow."""

import math

import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.geometry import Twist2D  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.description import lidar_elsewhere, urdf_of  # noqa: E402
from mbf_relay.simulation.node_parameters import SimulatorParameters  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.resources import find_resource  # noqa: E402
from mbf_relay.simulation.robot_file import load_robot  # noqa: E402
from mbf_relay.simulation.world import World  # noqa: E402

LIDAR = """
  <link name="laser"/>
  <joint name="laser_joint" type="fixed"><parent link="base_link"/><child link="laser"/>
    <origin xyz="0.1 0 0.2"/></joint>
  <gazebo reference="laser"><sensor type="{kind}" name="laser"><update_rate>{rate}</update_rate>
    <ray><scan><horizontal>
      <samples>541</samples><min_angle>{first}</min_angle><max_angle>{last}</max_angle></horizontal></scan>
    <range><min>0.05</min><max>8.0</max></range></ray></sensor></gazebo>"""
BODY = """
  <link name="base_link"><inertial><mass value="9.0"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><box size="0.5 0.3 0.12"/></geometry></collision></link>"""
DIFF_DRIVE = """
  <gazebo><plugin name="drive" filename="libgazebo_ros_diff_drive.so">
    <leftJoint>left_wheel_joint</leftJoint><rightJoint>right_wheel_joint</rightJoint></plugin></gazebo>"""
PLANAR = '<gazebo><plugin name="drive" filename="libgazebo_ros_planar_move.so"/></gazebo>'


def wheel(name, x, y, kind="continuous", radius=0.06, parent="base_link", z=0.0, tag="collision", more=""):
    """Return a wheel that turns about y, as most describe one: a cylinder lying on its side."""
    return f"""
  <link name="{name}"><{tag}><origin rpy="1.5707963 0 0"/>
    <geometry><cylinder radius="{radius}" length="0.03"/></geometry></{tag}></link>
  <joint name="{name}_joint" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="{x} {y} {z}"/>
    <axis xyz="0 1 0"/>{more}</joint>"""


def lidar(kind="ray", rate=40, first=-2.356, last=2.356):
    return LIDAR.format(kind=kind, rate=rate, first=first, last=last)


def swing(name, x, y, kind="revolute", limit='<limit lower="-0.5" upper="0.5"/>'):
    """Return a link that turns about an upright axis."""
    return f"""
  <link name="{name}"/>
  <joint name="{name}_joint" type="{kind}"><parent link="base_link"/><child link="{name}"/><origin xyz="{x} {y} 0"/>
    <axis xyz="0 0 1"/>{limit}</joint>"""


WHEELS = wheel("left_wheel", 0.0, 0.17) + wheel("right_wheel", 0.0, -0.17)
STEERED = swing("left_hinge", 0.3, 0.17) + swing("right_hinge", 0.3, -0.17) + wheel(
    "front_left_wheel", 0.0, 0.0, parent="left_hinge") + wheel("front_right_wheel", 0.0, 0.0, parent="right_hinge")


@pytest.fixture
def robot(tmp_path):
    """Return what reads the robot whose description has these elements."""

    def read(*elements, name="mine"):
        path = tmp_path / f"{name}.urdf"
        path.write_text(f'<robot name="{name}">{"".join(elements)}</robot>', encoding="utf-8")
        return load_robot(str(path))

    return read


def simulate(model, *bodies):
    parameters = SimulationParameters.from_mapping({**trial.EXACT, **model.settings, "scan_rate": 0.0})
    return Simulation(World("test", bodies), parameters, 1, robot=model)


@pytest.mark.parametrize("name", ["burger", "waffle", "medium", "large", "small"])
def test_a_robot_read_back_from_its_description_is_the_same(tmp_path, name):
    made = load_robot(name)
    path = tmp_path / "again.urdf"
    path.write_text(urdf_of(made), encoding="utf-8")
    read = load_robot(str(path))
    assert read.drive == made.drive
    assert read.wheels.separation == pytest.approx(made.wheels.separation)
    assert read.wheels.radius == pytest.approx(made.wheels.radius, rel=0.01)
    assert read.scan_height == pytest.approx(made.scan_height, abs=0.01 * made.wheels.radius)
    assert read.scan_in_base.position[:2] == pytest.approx(made.scan_in_base.position[:2])
    assert read.frames["base_frame"] == "base_footprint" and read.root == ""
    assert read.outline.min(axis=0) == pytest.approx(made.outline.min(axis=0), abs=0.02 * made.height + 0.005)
    assert read.outline.max(axis=0) == pytest.approx(made.outline.max(axis=0), abs=0.02 * made.height + 0.005)
    assert sum(part.mass for part in read.body) == pytest.approx(sum(part.mass for part in made.body), rel=0.01)
    assert read.joints == made.joints
    assert lidar_elsewhere(urdf_of(made), "base_footprint", "base_scan", read) == ""


def test_wheels_lidar_and_names_are_those_of_the_description(robot):
    caster = swing("fork", -0.2, 0.0, "continuous", "") + wheel("ball", 0.0, 0.0, radius=0.03, parent="fork", z=-0.03)
    arm = swing("arm", 0.0, 0.0)
    read = robot(BODY, WHEELS, caster, arm, lidar(), DIFF_DRIVE)
    assert read.drive == "differential" and read.joints == ("left_wheel_joint", "right_wheel_joint")
    assert (read.wheels.separation, read.base_height) == pytest.approx((0.34, 0.06), rel=0.01)
    assert set(read.still_joints) == {"fork_joint", "ball_joint", "arm_joint"}
    assert dict(read.frames) == {"base_frame": "base_link", "scan_frame": "laser"}
    assert read.scan_in_base.position == pytest.approx([0.1, 0.0, 0.2])
    parameters = SimulationParameters.from_mapping(read.settings)
    assert len(parameters.beam_directions) == pytest.approx(541, abs=1)
    assert parameters.beam_directions[0] == pytest.approx(-2.356, abs=0.01)
    assert (parameters.scan_rate, parameters.scan_range_min, parameters.scan_range_max) == (40.0, 0.05, 8.0)
    assert sorted(round(place.x, 2) for place in read.casters)[0] == -0.2
    assert read.outline.ptp(axis=0) == pytest.approx([0.5, 0.37], abs=0.001)
    assert sum(part.mass for part in read.body) == pytest.approx(9.0)


@pytest.mark.parametrize("elements", [
    (WHEELS, DIFF_DRIVE),
    (WHEELS,),
    (wheel("fl", 0.2, 0.17), wheel("fr", 0.2, -0.17), wheel("rl", -0.2, 0.17), wheel("rr", -0.2, -0.17)),
    (wheel("left_wheel", 0.0, 0.17, "fixed", tag="visual"), wheel("right_wheel", 0.0, -0.17, "fixed", tag="visual")),
    (wheel("left_wheel", -0.15, 0.17), wheel("right_wheel", -0.15, -0.17)),
], ids=["plugin", "none told", "four wheels", "only shown", "axle behind"])
def test_it_goes_straight_and_turns_about_its_axle(robot, elements):
    read = robot(BODY, *elements, lidar())
    with simulate(read) as simulation:
        trial.run(simulation, 3.0, Twist2D(0.4, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(0.4, rel=0.03)
        assert abs(simulation.true_pose.y) < 0.01 and abs(simulation.true_pose.theta) < 0.01
        trial.run(simulation, 2.0, Twist2D(0.0, 0.0, 0.0))
        before = simulation.true_pose
        trial.run(simulation, 3.0, Twist2D(0.0, 0.0, 0.8))
        after = simulation.true_pose
        assert after.theta - before.theta == pytest.approx(2.2, abs=0.3)
        assert math.hypot(after.x - before.x, after.y - before.y) < 0.03


@pytest.mark.parametrize("mass", ["1.0", "9.0", "180.0"])
def test_a_heavy_robot_follows_its_commands_though_nothing_is_said_of_its_wheels_mass(robot, mass):
    """One of 180 kg had not half the speed it was told after a second, and told to stop it swung to and fro."""
    with simulate(robot(BODY.replace("9.0", mass), WHEELS, DIFF_DRIVE, lidar())) as simulation:
        trial.run(simulation, 1.0, Twist2D(0.3, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(0.3, abs=0.01)
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 1.0))
        assert simulation.true_velocity.x == pytest.approx(0.0, abs=0.02)
        assert simulation.true_velocity.theta == pytest.approx(1.0, abs=0.05)


def test_a_wheel_beside_the_body_does_not_pass_through_a_post(robot):
    """The body is 0.15 m wide to each side, and the wheels reach to 0.185 m: they drove through what stood there."""
    post = trial.box("post", 0.5, 0.175, (0.02, 0.02, 0.5))
    with simulate(robot(BODY, WHEELS, DIFF_DRIVE, lidar()), post) as simulation:
        seen = trial.run(simulation, 3.0, Twist2D(0.3, 0.0, 0.0))
    assert {contact.name for observed in seen for contact in observed.contacts} == {"post"}


def test_a_robot_turns_about_its_axle_and_its_description_hangs_where_that_is(robot):
    """Taken to turn about base_link, a robot swung aside into what its controller had seen room beside."""
    read = robot(BODY, wheel("left_wheel", -0.15, 0.17), wheel("right_wheel", -0.15, -0.17), lidar())
    assert read.frames["base_frame"] == "turning_center" and read.root == "base_link"
    assert read.root_in_base.position == pytest.approx([0.15, 0.0, 0.06], abs=0.001)
    assert read.scan_in_base.position == pytest.approx([0.25, 0.0, 0.2])
    assert read.outline.max(axis=0)[0] == pytest.approx(0.4)
    plain = robot(BODY, WHEELS, lidar(), name="plain")
    assert plain.root == "" and plain.outline.max(axis=0)[0] == pytest.approx(0.25)


def test_ahead_is_where_its_base_looks(robot):
    """A robot whose base_link looks back drove into what stood before it, its lidar turned away."""
    turned = """
  <link name="base_footprint"/>
  <joint name="base_joint" type="fixed"><parent link="base_footprint"/><child link="base_link"/>
    <origin xyz="0 0 0.06" rpy="0 0 3.14159265"/></joint>"""
    read = robot(turned, BODY, WHEELS, lidar())
    assert read.scan_in_base.position[:2] == pytest.approx([-0.1, 0.0], abs=1e-6)
    assert abs(read.scan_in_base.flat().theta) == pytest.approx(math.pi)
    assert read.joints == ("right_wheel_joint", "left_wheel_joint"), "what is to the left, whatever it is called"
    said = DIFF_DRIVE.replace("<leftJoint>", "<robotBaseFrame>base_link</robotBaseFrame><leftJoint>")
    read = robot(turned, BODY, WHEELS, lidar(), said, name="said")
    assert read.scan_in_base.position[:2] == pytest.approx([0.1, 0.0], abs=1e-6)
    assert read.frames["base_frame"] == "turning_center" and read.root == "base_footprint"
    assert abs(read.root_in_base.flat().theta) == pytest.approx(math.pi)


def test_what_moves_sideways_in_gazebo_does_so_here_without_wheels_too(robot):
    for wheels in ("", "".join(wheel(n, x, y) for n, x, y in (
            ("fl", 0.2, 0.17), ("fr", 0.2, -0.17), ("rl", -0.2, 0.17), ("rr", -0.2, -0.17)))):
        read = robot(BODY, wheels, lidar(), PLANAR, name=f"omni{len(wheels)}")
        assert read.drive == "omnidirectional"
        with simulate(read) as simulation:
            trial.run(simulation, 2.0, Twist2D(0.0, 0.3, 0.0))
            assert simulation.true_velocity.y == pytest.approx(0.3, rel=0.05)


def test_wheels_that_steer_make_a_car_with_its_smallest_circle(robot):
    read = robot(BODY, WHEELS, STEERED, lidar())
    assert read.drive == "car" and read.joints == ("left_wheel_joint", "right_wheel_joint")
    assert read.wheels.base == pytest.approx(0.3)
    assert read.wheels.turning_radius == pytest.approx(0.3 / math.tan(0.5))


def test_a_lidar_without_a_sensor_of_gazebo_is_known_by_its_name(robot):
    named = (
        '<link name="my_laser"/>'
        '<joint name="m" type="fixed"><parent link="base_link"/><child link="my_laser"/></joint>')
    assert robot(BODY, WHEELS, named).frames["scan_frame"] == "my_laser"
    mount = (
        '<link name="laser_mount"/>'
        '<joint name="n" type="fixed"><parent link="base_link"/><child link="laser_mount"/>')
    on_it = named.replace('parent link="base_link"', 'parent link="laser_mount"').replace("<joint", "<joint ")
    read = robot(BODY, WHEELS, f'{mount}<origin xyz="0.1 0 0"/></joint>', on_it, name="mounted")
    assert read.frames["scan_frame"] == "my_laser" and read.scan_in_base.position[0] == pytest.approx(0.1)


def test_a_simulated_link_is_no_inertial_sensor(robot):
    """Its name was taken for one with an imu in it."""
    link = '<link name="{0}"/><joint name="{0}_j" type="fixed"><parent link="base_link"/><child link="{0}"/></joint>'
    read = robot(BODY, WHEELS, lidar(), link.format("simulated_part"), link.format("my_imu_link"))
    assert read.frames["imu_frame"] == "my_imu_link"


def test_a_cliff_sensor_is_no_lidar_and_a_wheel_in_the_middle_no_driven_one(robot):
    """Of a robot with both, what looks 0.1 rad down in front was taken for the lidar, and one side had three wheels."""
    cliff = lidar(first=-0.05, last=0.05).replace("laser", "cliff")
    front = wheel("front_wheel", 0.2, 0.0)
    read = robot(BODY, front, WHEELS, cliff, lidar())
    assert read.frames["scan_frame"] == "laser"
    assert read.joints == ("left_wheel_joint", "right_wheel_joint")
    assert read.wheels.separation == pytest.approx(0.34)
    assert 0.2 in [round(caster.x, 3) for caster in read.casters]


def test_rates_are_such_as_the_physics_has_and_a_full_turn_is_one(robot):
    read = robot(BODY, WHEELS, lidar("gpu_ray", 7, -math.pi, math.pi))
    parameters = SimulationParameters.from_mapping(read.settings)
    assert 6.5 < parameters.scan_rate <= 7.0 and parameters.scan_view == pytest.approx(2.0 * math.pi)


def test_what_lies_on_the_ground_is_lifted_off_it(robot):
    read = robot(BODY.replace('xyz="0 0 0.1"', 'xyz="0 0 0"'), WHEELS, lidar())
    lowest = min(part.frame.transform_points(part.shape.triangles().reshape(-1, 3))[:, 2].min() for part in read.body)
    assert read.base_height + lowest == pytest.approx(0.01)


def test_a_robot_is_not_taken_for_a_smaller_one_where_a_mesh_is_missing(robot):
    """Its outline is what keeps it off walls: the hull that was left out would have hit them."""
    mesh = (
        '<link name="hull"><collision><geometry><mesh filename="package://no_such/hull.stl"/></geometry></collision>'
        '</link><joint name="m" type="fixed"><parent link="base_link"/><child link="hull"/></joint>')
    with pytest.raises(ValueError, match="mine.urdf: link 'hull': 'package://no_such/hull.stl' was not found"):
        robot(BODY, WHEELS, mesh, lidar())
    with pytest.raises(ValueError, match="mine.urdf: link 'base_link': a <collision> has a geometry that is not under"):
        robot(BODY.replace('<box size="0.5 0.3 0.12"/>', '<capsule radius="0.2" length="0.3"/>'), WHEELS, lidar())


def test_a_shape_without_extent_is_none(robot):
    """A sonar that was only to be there, as a box of 0 0 0, had the robot refused."""
    sonar = (
        '<link name="sonar"><collision><geometry><box size="0 0 0"/></geometry></collision></link>'
        '<joint name="s" type="fixed"><parent link="base_link"/><child link="sonar"/></joint>')
    read = robot(BODY, WHEELS, sonar, lidar())
    assert len(read.body) == 1 and read.outline.ptp(axis=0) == pytest.approx([0.5, 0.37], abs=0.001)


def test_a_lidar_that_looks_to_one_side_is_told_of(robot):
    read = robot(BODY, WHEELS, lidar(first=-0.5, last=2.0))
    assert read.warnings == ("its lidar looks from -0.50 to 2.00 rad; as far to both sides is simulated",)


@pytest.mark.parametrize("elements, said", [
    ((BODY, lidar()), "it has no two wheels, one to each side"),
    ((BODY, wheel("left_wheel", 0.0, 0.17), lidar()), "its joints: laser_joint, left_wheel_joint"),
    ((BODY, WHEELS), "it has no lidar"),
    (('<link name="base_link"/>', WHEELS, lidar()), "no link but its wheels"),
    ((BODY.replace("0.5 0.3 0.12", "500 300 120"), WHEELS, lidar()), "reach over 500 m; lengths are in metres"),
    (("<link",), "no XML"),
    ((), "it has no link"),
    ((BODY, STEERED, lidar()), "all its wheels steer"),
    ((BODY, wheel("l", 0.4, 0.17), wheel("r", 0.4, -0.17), STEERED, lidar()), "cars steer in front"),
])
def test_what_is_missing_is_said_in_one_line_that_names_the_file(robot, elements, said):
    with pytest.raises(ValueError, match="robot file .*mine.urdf: ") as error:
        robot(*elements)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_xacro_is_told_how_to_become_one():
    with pytest.raises(ValueError, match="xacro robots/mine.urdf.xacro > mine.urdf"):
        load_robot("robots/mine.urdf.xacro")


def test_its_frames_are_called_as_its_description_has_them_unless_a_user_says_otherwise(robot, tmp_path):
    """A robot whose base is base_link had its odometry told of base_footprint, which nothing else knew."""
    robot(BODY, WHEELS, lidar())
    path = str(tmp_path / "mine.urdf")
    settings = SimulatorParameters.from_mapping({"robot": path})
    assert (settings.base_frame, settings.scan_frame, settings.imu_frame) == ("base_link", "laser", "imu_link")
    assert SimulatorParameters.from_mapping({"robot": path, "scan_frame": "front"}).scan_frame == "front"
    description = (tmp_path / "mine.urdf").read_text(encoding="utf-8")
    assert lidar_elsewhere(description, settings.base_frame, settings.scan_frame, load_robot(path)) == ""


def test_joints_that_nothing_moves_are_told_to_be_at_zero(robot):
    """An arm without a joint state has no place in tf, and RViz shows it in red."""
    read = robot(BODY, WHEELS, swing("arm", 0.0, 0.0), lidar())
    with simulate(read) as simulation:
        joints = [seen.joints for seen in trial.run(simulation, 1.0, Twist2D(0.3, 0.0, 0.0)) if seen.joints][-1]
    assert joints.names == ("left_wheel_joint", "right_wheel_joint", "arm_joint")
    assert joints.positions[0] > 1.0 and joints.positions[2] == 0.0 and len(joints.velocities) == 3


def test_a_mesh_is_found_by_its_package_s_name_however_deep_it_lies(tmp_path, monkeypatch):
    package = tmp_path / "src" / "a" / "b" / "checked_out"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>deep_robot</name></package>", encoding="utf-8")
    (package / "part.stl").write_text("", encoding="utf-8")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    assert find_resource("package://deep_robot/part.stl", str(tmp_path)) == str(package / "part.stl")
