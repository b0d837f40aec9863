"""What amcl's parameter files say, and what is made of it."""

import pytest

from mbf_relay.localization.parameters import LocalizerParameters


@pytest.mark.parametrize("given, used", [
    ({"laser_model_type": "laser"}, {"laser_model_type": "likelihood_field"}),
    ({"odom_model_type": "differential"}, {"odom_model_type": "diff"}),
    ({"min_particles": 500, "max_particles": 200}, {"min_particles": 200, "max_particles": 200}),
    ({"min_particles": 6000}, {"min_particles": 5000, "max_particles": 5000}),
])
def test_a_robot_is_localized_by_a_file_that_amcl_takes(given, used):
    """amcl warns of a model it does not know, and takes the usual one; here the node ended."""
    made, notes = LocalizerParameters.read(given)
    assert {name: getattr(made, name) for name in used} == used and len(notes) == 1
    assert str(next(iter(given.values()))) in notes[0]


def test_unknown_settings_are_named():
    with pytest.raises(ValueError, match="min_particles is 10; it must be at most max_particles, which is 5"):
        LocalizerParameters(min_particles=10, max_particles=5)
    with pytest.raises(ValueError, match="laser_model_type is 'laser'"):
        LocalizerParameters(laser_model_type="laser")
