"""What a cost means is said once; kernels, whose compiled form is kept by their own file alone, hold copies."""

import importlib
import pkgutil

import mbf_relay
from mbf_relay.costmap import cost_grid

NAMES = ("FREE_SPACE", "INSCRIBED", "LETHAL", "NO_INFORMATION")


def test_copies_of_cost_values_are_like_the_original():
    found = 0
    for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay."):
        if module.name.endswith("_kernels"):
            held = vars(importlib.import_module(module.name))
            for name in NAMES:
                if f"_{name}" in held:
                    assert held[f"_{name}"] == getattr(cost_grid, name), f"{module.name}._{name}"
                    found += 1
    assert found >= 4
