"""An example of reinforcement learning: the cross-entropy method on a linear policy, with NumPy alone.

In each generation policies are drawn from a normal distribution, all drive the same episodes, and the distribution is
fitted to the best fifth of them (Rubinstein 1999). Added noise keeps it from converging too early (Szita and Lorincz
2006). The result is tested on worlds that were not used in training.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any, Callable, List, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.commands import positive, random_seed

Tell = Callable[[str], None]
"""Takes a line for the user."""
SECTORS, NEAR = 12, 0.3
"""Number of sectors of the scan, and the distance (m) at which the policy's input of a sector is 1."""
ELITE, EXTRA_NOISE = 0.2, 0.3
"""Share of the policies that the distribution is fitted to, and standard deviation added at first, 0 in the end."""


def act(weights: np.ndarray, seen: Any) -> np.ndarray:
    """Return a policy's action, shape (A,), for an observation; its weights have shape (A, SECTORS + 3)."""
    towards = seen["goal"] / max(1e-6, float(np.hypot(*seen["goal"])))
    action: np.ndarray = np.tanh(weights @ np.concatenate((towards, NEAR / np.maximum(seen["scan"], 0.1), [1.0])))
    return action


def drive(environment: Any, weights: np.ndarray, seeds: Sequence[int]) -> Tuple[float, float]:
    """Return a policy's mean return and share of successes over episodes of these seeds."""
    total, successes = 0.0, 0
    for seed in seeds:
        seen, info = environment.reset(seed=seed)
        over = False
        while not over:
            seen, reward, terminated, truncated, info = environment.step(act(weights, seen))
            total, over = total + reward, terminated or truncated
        successes += info["success"]
    return total / len(seeds), successes / len(seeds)


def train(
    environment: Any, generations: int, policies: int, episodes: int, seed: int, tell: Tell
) -> Tuple[np.ndarray, List[float]]:
    """Return the weights of the policy learnt, and the mean return of each generation's policies.

    Args:
        environment: See NavigationEnvironment.
        generations: Number of generations.
        policies: Number of policies in each.
        episodes: Number of episodes that each policy drives.
        seed: Seed of the policies and the episodes.
        tell: Called with a line for each generation.
    """
    rng = np.random.default_rng(seed)
    mean = np.zeros((environment.action_space.shape[0], SECTORS + 3))
    spread, returns = np.ones_like(mean), []
    for generation in range(generations):
        drawn = mean + spread * rng.standard_normal((policies, *mean.shape))
        seeds = rng.integers(2**31, size=episodes).tolist()
        found = np.array([drive(environment, weights, seeds)[0] for weights in drawn])
        best = drawn[np.argsort(found)[-max(2, round(ELITE * policies)):]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + EXTRA_NOISE * (1.0 - generation / generations)
        returns.append(float(found.mean()))
        tell(f"generation {generation + 1} of {generations}: return {found.mean():+.2f}, best {found.max():+.2f}")
    return mean, returns


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 for an error that a user can fix."""
    parser = argparse.ArgumentParser(prog="train_policy.py", description="Teach a linear policy to drive.")
    parser.add_argument("--worlds", default="barn", help="a kind of make_worlds.py, or a worlds file (default barn)")
    for name, value, kind, meaning in (
        ("generations", 15, positive, "rounds of drawing policies and keeping the best"),
        ("policies", 20, positive, "policies drawn in each round"),
        ("episodes", 3, positive, "episodes each policy drives"),
        ("seed", 1, random_seed, "seed of worlds and policies"),
    ):
        parser.add_argument(
            f"--{name}", type=kind, default=value, metavar="N", help=f"{meaning} (default {value})")
    options = parser.parse_args(arguments)
    try:
        from mbf_relay.lockstep.environment import NavigationEnvironment

        training, held_out = (
            NavigationEnvironment(options.worlds, seeds=seeds, beams=SECTORS) for seeds in ((1000, 100000), (0, 1000))
        )
        test = range(20)
        before = drive(held_out, np.zeros((training.action_space.shape[0], SECTORS + 3)), test)
        weights, _ = train(training, options.generations, options.policies, options.episodes, options.seed, print)
        for name, (mean, share) in (("before", before), ("after", drive(held_out, weights, test))):
            print(f"{name}, {len(test)} episodes not trained on: return {mean:+.2f}, {100.0 * share:.0f} % at the goal")
    except ImportError as error:
        print(f"train_policy.py: learning needs gymnasium (pip install gymnasium): {error}", file=sys.stderr)
        return 1
    except ValueError as error:
        print(f"train_policy.py: {error}", file=sys.stderr)
        return 1
    return 0
