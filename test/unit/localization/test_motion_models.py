import math

import numpy as np
import pytest

from mbf_relay.geometry import IDENTITY, Pose2D, normalize_angles
from mbf_relay.localization.gaussians import PoseGaussian
from mbf_relay.localization.motion_kernels import turn_drive_turn
from mbf_relay.localization.motion_models import make_motion_model
from mbf_relay.localization.parameters import LocalizerParameters

COUNT = 40000
STEP = Pose2D(0.8, 0.3, 0.5)


def propagate(kind, step=STEP, count=COUNT, robust=False, start=(1.0, 2.0, 0.7), **alphas):
    values = {f"odom_alpha{i}": alphas.get(f"a{i}", 0.0) for i in range(1, 6)}
    model = make_motion_model(LocalizerParameters(odom_model_type=kind, robust=robust, robust_odom_error=0.0, **values))
    before = Pose2D(5.0, -3.0, 1.1)
    poses = model.propagate(
        np.tile(start, (count, 1)).astype(float), before, before.compose(step), np.random.default_rng(1)
    )
    return Pose2D(*start).inverse().transform_poses(poses)


@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
@pytest.mark.parametrize(
    "step", [STEP, Pose2D(-0.5, 0.0, 0.0), Pose2D(0.0, 0.0, 2.5), Pose2D(0.0, 0.4, -0.2), IDENTITY]
)
def test_without_noise_particles_move_as_odometry_did(kind, step):
    moved = propagate(kind, step, count=3)
    assert moved == pytest.approx(np.tile(np.array(step), (3, 1)), abs=1e-9)


@pytest.mark.parametrize("kind, root", [("diff", False), ("diff-corrected", True)])
def test_moments_of_the_differential_model(kind, root):
    """Straight ahead, alpha 3 spreads along the way, alpha 2 the two turns."""
    driven, a2, a3 = 0.6, 0.05, 0.08
    moved = propagate(kind, Pose2D(driven, 0.0, 0.0), a2=a2, a3=a3)
    deviation = (lambda v: math.sqrt(v)) if root else (lambda v: v)
    turn, along = deviation(a2 * driven ** 2), deviation(a3 * driven ** 2)
    distance = np.hypot(moved[:, 0], moved[:, 1])
    if along < 0.2 * driven:
        assert distance.mean() == pytest.approx(driven, abs=4 * along / math.sqrt(COUNT))
        assert distance.std() == pytest.approx(along, rel=0.03)
    first = np.arctan2(moved[:, 1], moved[:, 0])[distance > 0.1]
    assert moved[:, 2].std() == pytest.approx(math.sqrt(2.0) * turn, rel=0.03)  # two independent turns
    assert abs(np.median(first)) < 4 * turn / math.sqrt(COUNT)


def test_turning_on_the_spot_spreads_the_heading_by_alpha_1_and_the_position_by_alpha_4():
    moved = propagate("diff", Pose2D(0.0, 0.0, 1.2), a1=0.1, a4=0.02)
    assert moved[:, 2].std() == pytest.approx(0.1 * 1.2 ** 2, rel=0.03)
    assert np.hypot(moved[:, 0], moved[:, 1]).max() > 0.0
    assert np.sqrt((moved[:, :2] ** 2).sum(axis=1).mean()) == pytest.approx(0.02 * 1.2 ** 2, rel=0.03)


def test_driving_backwards_is_no_half_turn():
    moved = propagate("diff", Pose2D(-0.5, 0.0, 0.0), a1=0.5, a4=0.5)
    assert moved[:, 2].std() < 1e-9
    assert moved[:, 0].std() < 1e-9


@pytest.mark.parametrize(
    "kind, alpha, along, heading, across",
    [
        ("omni", "a1", "turned", None, "turned"),
        ("omni", "a2", None, "driven", None),
        ("omni", "a3", "driven", None, None),
        ("omni", "a4", None, "turned", None),
        ("omni", "a5", None, None, "driven"),
        ("omni-corrected", "a1", None, "turned", None),
        ("omni-corrected", "a2", None, "driven", None),
        ("omni-corrected", "a3", "driven", None, None),
        ("omni-corrected", "a4", "turned", None, "turned"),
        ("omni-corrected", "a5", None, None, "driven"),
    ],
)
def test_each_alpha_of_the_omnidirectional_models(kind, alpha, along, heading, across):
    """Sideways, so that along and across are seen apart from forward and left."""
    driven, turned, value = 0.7, 0.4, 0.03
    moved = propagate(kind, Pose2D(0.0, driven, turned), **{alpha: value})
    motions = {"driven": driven, "turned": turned}

    def deviation(name):
        square = value * motions[name] ** 2 if name else 0.0
        return math.sqrt(square) if kind.endswith("corrected") else square

    assert moved[:, 1].std() == pytest.approx(deviation(along), rel=0.03, abs=1e-9)
    assert moved[:, 2].std() == pytest.approx(deviation(heading), rel=0.03, abs=1e-9)
    assert moved[:, 0].std() == pytest.approx(deviation(across), rel=0.03, abs=1e-9)


def drive_in_steps(kind, way, steps, **values):
    """Return where particles are after a way, cut into so many equal steps, in the frame of its start."""
    model = make_motion_model(LocalizerParameters(odom_model_type=kind, **values))
    poses, rng, before = np.zeros((4000, 3)), np.random.default_rng(1), Pose2D(5.0, -3.0, 1.1)
    for _ in range(steps):
        share = 1.0 / steps
        after = before.compose(Pose2D(way.x * share, way.y * share, way.theta * share))
        poses, before = model.propagate(poses, before, after, rng), after
    return poses


@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
@pytest.mark.parametrize("way", [Pose2D(1.0, 0.0, 0.0), Pose2D(0.0, 0.0, 1.5)], ids=["straight", "turn"])
def test_a_way_is_as_uncertain_whatever_steps_it_is_cut_into(kind, way):
    """A robot that updates every 2 cm must not be surer of its odometry, or less sure, than one that does every metre.
    """
    ends = [drive_in_steps(kind, way, steps) for steps in (1, 4, 20, 100)]
    places = [math.sqrt(poses[:, :2].var(axis=0).sum()) for poses in ends]
    headings = [poses[:, 2].std() for poses in ends]
    assert max(places) < 1.2 * min(places)
    assert max(headings) < 1.1 * min(headings)


def test_the_robust_form_is_as_wide_as_amcl_at_amcls_own_step():
    step = Pose2D(0.2, 0.0, 0.0)
    plain, robust = (propagate("diff", step, robust=robust, a3=0.3)[:, 0].std() for robust in (False, True))
    assert robust == pytest.approx(plain, rel=0.03)


def test_the_robust_form_holds_odometry_to_be_off_at_least_by_so_much_after_a_metre():
    moved = drive_in_steps("omni", Pose2D(1.0, 0.0, 0.0), 5, robust_odom_error=0.1, odom_alpha3=0.0, odom_alpha2=0.0)
    assert moved[:, 0].std() == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("kind", ["omni", "omni-corrected"])
def test_a_robot_that_turns_right_is_tracked_as_one_that_turns_left(kind, robust):
    alphas = {"a1": 0.2, "a2": 0.2, "a3": 0.2, "a4": 0.2, "a5": 0.2}
    left, right = (
        propagate(kind, Pose2D(0.1, 0.0, turn), robust=robust, **alphas).std(axis=0) for turn in (0.5, -0.5))
    assert right == pytest.approx(left)


@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
def test_rivals_grow_as_uncertain_as_particles(kind):
    """The covariance that a hypothesis is moved with is that of the particles' noise."""
    model = make_motion_model(LocalizerParameters(odom_model_type=kind, robust_odom_error=0.02))
    before, after = Pose2D(1.0, 2.0, 0.7), Pose2D(1.0, 2.0, 0.7).compose(Pose2D(0.3, 0.1, 0.2))
    start = PoseGaussian(np.array([3.0, -1.0, 2.0]), np.diag([1e-8, 1e-8, 1e-8]))
    moved = model.propagate(np.tile(start.mean, (COUNT, 1)), before, after, np.random.default_rng(1))
    belief = start.moved(after.relative_to(before), model.covariance(before, after))
    assert moved.mean(axis=0) == pytest.approx(belief.mean, abs=0.01)
    scale = np.sqrt(np.outer(np.diag(belief.covariance), np.diag(belief.covariance)))
    assert np.cov(moved.T) / scale == pytest.approx(belief.covariance / scale, abs=0.08)


def test_particles_move_as_plain_numpy_has_it():
    rng = np.random.default_rng(2)
    poses, noise = rng.uniform(-4.0, 4.0, (500, 3)), rng.standard_normal((3, 500))
    motion, deviations, moved = np.array([0.3, -0.7, 2.9]), np.array([0.1, 0.2, 0.3]), np.empty((500, 3))
    turn_drive_turn(poses, noise, motion, deviations, moved)
    first, way, second = motion[:, None] + deviations[:, None] * noise
    headings = poses[:, 2] + first
    ends = poses[:, :2] + (way * np.array([np.cos(headings), np.sin(headings)])).T
    assert moved[:, :2] == pytest.approx(ends, abs=1e-12)
    assert moved[:, 2] == pytest.approx(normalize_angles(headings + second), abs=1e-12)


def test_headings_stay_on_their_circle():
    moved = make_motion_model(LocalizerParameters()).propagate(
        np.tile((0.0, 0.0, 3.1), (1000, 1)), IDENTITY, Pose2D(0.1, 0.0, 0.5), np.random.default_rng(2)
    )
    assert (np.abs(moved[:, 2]) <= math.pi).all()
