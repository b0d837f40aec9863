import math

import numpy as np
import pytest

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.motion_models import make_motion_model
from mbf_relay.localization.parameters import LocalizerParameters

COUNT = 40000
STEP = Pose2D(0.8, 0.3, 0.5)


def propagate(kind, step=STEP, count=COUNT, robust=False, start=(1.0, 2.0, 0.7), **alphas):
    values = {f"odom_alpha{i}": alphas.get(f"a{i}", 0.0) for i in range(1, 6)}
    model = make_motion_model(LocalizerParameters(odom_model_type=kind, robust=robust, robust_odom_error=0.0, **values))
    before = Pose2D(5.0, -3.0, 1.1)
    poses = model.propagate(np.tile(start, (count, 1)).astype(float), before, before.compose(step), np.random.default_rng(1))
    return Pose2D(*start).inverse().transform_poses(poses)


@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
@pytest.mark.parametrize("step", [STEP, Pose2D(-0.5, 0.0, 0.0), Pose2D(0.0, 0.0, 2.5), Pose2D(0.0, 0.4, -0.2), IDENTITY])
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
        ("omni", "a1", "turned", None, "turned"), ("omni", "a2", None, "driven", None), ("omni", "a3", "driven", None, None),
        ("omni", "a4", None, "turned", None), ("omni", "a5", None, None, "driven"),
        ("omni-corrected", "a1", None, "turned", None), ("omni-corrected", "a2", None, "driven", None),
        ("omni-corrected", "a3", "driven", None, None), ("omni-corrected", "a4", "turned", None, "turned"),
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


def test_the_robust_form_reads_alphas_as_shares_of_the_motion():
    for driven in (0.1, 1.0, 3.0):
        moved = propagate("diff", Pose2D(driven, 0.0, 0.0), robust=True, a3=0.1)
        assert moved[:, 0].std() == pytest.approx(0.1 * driven, rel=0.03)


def test_the_robust_form_holds_odometry_to_be_off_by_a_share_at_least():
    model = make_motion_model(LocalizerParameters(robust_odom_error=0.2, odom_alpha3=0.0))
    moved = model.propagate(np.zeros((COUNT, 3)), IDENTITY, Pose2D(0.5, 0.0, 0.0), np.random.default_rng(1))
    assert np.hypot(moved[:, 0], moved[:, 1]).std() == pytest.approx(0.1, rel=0.03)


def test_headings_stay_on_their_circle():
    moved = make_motion_model(LocalizerParameters()).propagate(
        np.tile((0.0, 0.0, 3.1), (1000, 1)), IDENTITY, Pose2D(0.1, 0.0, 0.5), np.random.default_rng(2)
    )
    assert (np.abs(moved[:, 2]) <= math.pi).all()
