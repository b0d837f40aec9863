"""What the robot touches, pushes, and is pushed by."""

import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.geometry import Twist2D  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.physics import ANY  # noqa: E402
from mbf_relay.simulation.shapes import Body, Box, Cylinder  # noqa: E402
from mbf_relay.simulation.world import Mover  # noqa: E402


@pytest.mark.parametrize("gap, expected", [(0.094, False), (0.084, True)])
def test_the_robot_is_as_wide_as_its_wheels(gap, expected):
    post = Body("post", Cylinder(0.03, 0.5), Frame.of(0.3, gap + 0.03, 0.25))
    with trial.simulate([post]) as simulation:
        seen = trial.run(simulation, 2.5, Twist2D(0.2, 0.0, 0.0))
        assert any(o.contacts for o in seen) is expected, "wheels reach 0.089 m to the side"


def test_a_touch_is_told_with_its_place_and_the_others_name():
    bodies = [trial.box("wall", 1.0, 0.0, (0.2, 4.0, 1.0)), trial.box("other", -1.0, 0.0, (0.2, 4.0, 1.0))]
    with trial.simulate(bodies) as simulation:
        seen = trial.run(simulation, 8.0, Twist2D(0.2, 0.0, 0.0))
        touches = [contact for o in seen for contact in o.contacts]
        assert touches and {touch.name for touch in touches} == {"wall"}
        assert touches[0].position[0] == pytest.approx(0.9, abs=0.01)
        assert simulation.true_pose.x < 0.9
        # Off the wall again: nothing is wound up in the wheels.
        trial.run(simulation, 2.0, Twist2D(-0.1, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(-0.1, rel=0.05)
        assert not trial.run(simulation, 0.5)[-1].contacts


def test_what_is_asked_of_one_wall_is_what_all_contacts_tell_of_it():
    with trial.simulate([trial.box("wall", 0.5, 0.3, (0.2, 0.7, 1.0), yaw=0.4)]) as simulation:
        physics, robot, touched = simulation.physics, simulation.base.body, 0
        (wall,) = set(range(physics.ground + 1, robot))
        for speed in (0.2, -0.2):
            for _ in range(300):
                simulation.set_command(Twist2D(speed, 0.0, 0.0))
                simulation.step()
                points = physics.contacts(robot, wall)
                assert list(points) == [p for p in physics.contacts(robot, ANY) if p[2] != physics.ground]
                touched += len(points) > 0
        assert touched > 20


def test_an_obstacle_set_anew_is_touched_by_its_new_name():
    """A box of the same size kept the name of the one before: the report blamed what had stood there last."""
    with trial.simulate() as simulation:
        for name in ("crate", "chair"):
            simulation.scene.set_obstacle("a", trial.box(name, 0.5, 0.0, (0.2, 0.2, 0.4)))
        seen = trial.run(simulation, 3.0, Twist2D(0.2, 0.0, 0.0))
        assert {contact.name for o in seen for contact in o.contacts} == {"chair"}


def test_loose_bodies_are_pushed_and_named():
    ball = Body("crate", Box((0.2, 0.2, 0.2)), Frame.of(0.5, 0.0, 0.1), mass=0.1)
    with trial.simulate([ball]) as simulation:
        seen = trial.run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        assert "crate" in {contact.name for o in seen for contact in o.contacts}
        crate = [body for body in simulation.scene.bodies() if body.name == "crate"][0]
        assert crate.frame.position[0] > 0.6
        simulation.reset()
        crate = [body for body in simulation.scene.bodies() if body.name == "crate"][0]
        assert crate.frame.position[0] == pytest.approx(0.5)


def test_movers_keep_their_times():
    mover = Mover(
        Body("cart", Cylinder(0.1, 0.4), Frame.of(0.0, 0.0, 0.2)), [0.0, 2.0, 4.0], [[1, 0, 0], [2, 0, 0], [1, 0, 0]]
    )
    with trial.simulate(movers=[mover]) as simulation:
        for seconds, x in ((1.0, 1.5), (1.0, 2.0), (1.0, 1.5), (1.0, 1.0), (1.0, 1.5)):
            assert trial.last_scan(simulation, seconds).ranges[0] == pytest.approx(x - 0.1 - trial.SENSOR_X, abs=5e-3)
        hit = Mover(
            Body("ram", Cylinder(0.1, 0.4), Frame.of(0.0, 0.0, 0.2)), [0.0, 4.0], [[1, 0, 0], [0, 0, 0]], loop=False
        )
    with trial.simulate(movers=[hit]) as simulation:
        assert "ram" in {contact.name for o in trial.run(simulation, 5.0) for contact in o.contacts}
