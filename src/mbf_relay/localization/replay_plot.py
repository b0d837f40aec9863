"""The plot of a replay: the map with the trajectories, and the error over time."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import numpy as np  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.transforms import Affine2D  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.localization.logs import RecordedLog  # noqa: E402
from mbf_relay.localization.replay import Replay, errors  # noqa: E402
from mbf_relay.maps import OccupancyMap  # noqa: E402
from mbf_relay.whole_files import whole_file  # noqa: E402


def draw_replay(path: str, log: RecordedLog, occupancy: OccupancyMap, result: Replay) -> None:
    """Draw the estimate, the odometry laid at its start, and the reference where there is one; OSError if it fails."""
    rows = 1 if log.reference is None else 2
    figure = Figure(figsize=(10.0, 8.0 + 2.5 * (rows - 1)), tight_layout=True)
    grid = figure.add_gridspec(rows, 1, height_ratios=[4, 1][:rows])
    _draw_ways(figure.add_subplot(grid[0]), log, occupancy, result)
    if log.reference is not None:
        _draw_errors(figure.add_subplot(grid[1]), log.reference, result)
    with whole_file(path) as stream:
        figure.savefig(stream, dpi=100, format="png")


def _draw_ways(axes: Axes, log: RecordedLog, occupancy: OccupancyMap, result: Replay) -> None:
    height, width = occupancy.data.shape
    shades = np.where(occupancy.data < 0, 0.85, 1.0 - np.clip(occupancy.data, 0, 100) / 100.0)
    origin = occupancy.origin
    turn = Affine2D().rotate_around(origin.x, origin.y, origin.theta)
    axes.imshow(
        shades,
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        interpolation="nearest",
        transform=turn + axes.transData,
        extent=(origin.x, origin.x + width * occupancy.resolution, origin.y, origin.y + height * occupancy.resolution),
    )
    known = np.isfinite(log.odom).all(axis=1)
    if known.any():
        first = int(np.argmax(known))
        to_map = Pose2D(*map(float, result.poses[first])).compose(Pose2D(*map(float, log.odom[first])).inverse())
        way = to_map.transform_poses(log.odom[known])
        axes.plot(way[:, 0], way[:, 1], color="0.6", linewidth=0.8, label="odometry")
    if log.reference is not None:
        axes.plot(
            log.reference[:, 0], log.reference[:, 1], color="tab:green", linewidth=2.5, alpha=0.6, label="reference"
        )
    axes.plot(result.poses[:, 0], result.poses[:, 1], color="tab:blue", linewidth=1.0, label="estimate")
    shown = result.poses if log.reference is None else np.vstack((result.poses, log.reference))
    low, high = np.nanmin(shown[:, :2], axis=0) - 3.0, np.nanmax(shown[:, :2], axis=0) + 3.0
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(loc="best")


def _draw_errors(axes: Axes, reference: np.ndarray, result: Replay) -> None:
    off = errors(result.poses, reference)
    axes.plot(off["translation"], color="tab:blue", linewidth=1.0, label="translation [m]")
    axes.plot(off["rotation"], color="tab:orange", linewidth=1.0, label="rotation [rad]")
    axes.set(xlabel="scan", ylabel="error", ylim=(0.0, None))
    axes.legend(loc="best")
