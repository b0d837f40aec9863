#!/usr/bin/env python3
"""The circle through the nodes and in lockstep: the same parts with the same files give two drives of one kind."""

import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from std_srvs.srv import Empty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.geometry import normalize_angles  # noqa: E402
from mbf_relay.lockstep import Episode, circle, config_folder, make_setup  # noqa: E402
from mbf_relay.lockstep.smoothness import path_length  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE  # noqa: E402


class TestLockstep(unittest.TestCase):
    def test_the_nodes_and_lockstep_drive_alike(self):
        witness = Witness()
        run = run_client("mb_relay_client.py")
        self.assertEqual(run.status, 0, run.output)
        self.assertEqual(witness.touched(), [])
        by_nodes = witness.trajectory
        rospy.ServiceProxy("simulator/pause", Empty)()  # nobody looks at the nodes any more, and they compute on

        result = Episode(circle(), make_setup(config_folder()), seed=1).run()
        self.assertTrue(result.success, result.message)
        self.assertEqual((result.goals_reached, result.contacts), (len(CIRCLE), 0))
        in_lockstep = np.array(result.trajectory)

        self.assertLess(abs(time_on_the_way(by_nodes) / time_on_the_way(in_lockstep) - 1.0), 0.1)
        self.assertLess(abs(path_length(by_nodes[:, 1:3]) / result.path_length - 1.0), 0.05)
        self.assertLess(np.median(distances(by_nodes[:, 1:3], in_lockstep[:, 1:3])), 0.1)


def time_on_the_way(rows):
    """Return the seconds from the first motion to the last; rows are time, x, y, heading."""
    moved = np.hypot(*np.diff(rows[:, 1:3], axis=0).T) + np.abs(normalize_angles(np.diff(rows[:, 3])))
    moving = np.flatnonzero(moved > 1e-3)
    return rows[moving[-1] + 1, 0] - rows[moving[0], 0]


def distances(points, others):
    """Return how far (m) each point is from the nearest of the others."""
    return np.hypot(*(points[:, None] - others[None]).T).min(axis=0)


if __name__ == "__main__":
    start_test_node("lockstep_test")
    rostest.rosrun("mbf_relay", "lockstep", TestLockstep)
