"""The built-in critics under names of a user's own: subclasses with empty bodies."""

from mbf_relay.control.critics import CRITICS
from mbf_relay.control.critics.critic import Critic
from mbf_relay.plugins import find_class

BY_NAME = {name: type(f"Own{index}", (find_class(name, Critic, CRITICS),), {}) for index, name in enumerate(CRITICS)}
globals().update({made.__name__: made for made in BY_NAME.values()})


def path_of(name):
    """Return the module path of the class that stands for a built-in critic."""
    return f"{__name__}.{BY_NAME[name].__name__}"
