"""Recorded logs of odometry and scans, kept as .npz files without ROS."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO, Dict, List, Optional

import numpy as np

from mbf_relay import files
from mbf_relay.geometry import FARTHEST, IDENTITY, Pose2D
from mbf_relay.scan import LaserScan
from mbf_relay.whole_files import whole_file

LARGEST_LOG = 4 << 30
"""Largest size (bytes) of a log, unpacked: a day of 1000 beams at 5 Hz."""
LARGEST_ANGLE = 100.0
"""Largest magnitude (rad) of angle_min and angle_increment."""
CROWDED = 0.002
"""Share of all readings with the same value from which on that value means "nothing came back"."""


SPARSEST = 10.0
"""Time (s) between scans above which times are in another unit: 100 scans a second are 10 ms apart."""


class LogError(ValueError):
    """A log's file lacks an array or holds one of a wrong shape; the text names file and array."""


@dataclass(frozen=True)
class RecordedLog:
    """Scans of a drive, with odometry.

    Attributes:
        times: Shape (N,), seconds.
        odom: Shape (N, 3): x, y (m), yaw (rad) of the base in the odometry frame at each scan.
        ranges: Shape (N, B), metres.
        angle_min, angle_increment: Of the scans, radians.
        range_max: Readings (m) of this and more are invalid.
        reference: Shape (N, 3): true pose of the base in the map's frame at each scan; None where not known.
        laser_pose: Pose of the sensor in the base's frame.
        range_min: Readings (m) up to this are invalid: many lidars send error codes as ranges of a few millimetres.
    """

    times: np.ndarray
    odom: np.ndarray
    ranges: np.ndarray
    angle_min: float
    angle_increment: float
    range_max: float
    reference: Optional[np.ndarray] = None
    laser_pose: Pose2D = IDENTITY
    range_min: float = 0.0

    def __len__(self) -> int:
        return len(self.times)

    def scan(self, index: int) -> LaserScan:
        """Return a scan of the log."""
        return LaserScan(
            self.ranges[index],
            self.angle_min,
            self.angle_increment,
            self.range_min,
            self.range_max,
            float(self.times[index]),
            "laser",
        )

    def odom_pose(self, index: int) -> Pose2D:
        """Return the odometry pose of a scan."""
        return Pose2D(*map(float, self.odom[index]))


def doubts_on_times(log: RecordedLog) -> List[str]:
    """Return a line for each thing that is wrong with a log's times, which jumps of odometry are detected by."""
    with np.errstate(invalid="ignore"):
        steps = np.diff(log.times)
    still, rising = np.flatnonzero(~(steps > 0.0)), steps[steps > 0.0]
    lines = []
    if len(still):
        lines.append(f"{len(still)} of {len(log)} times do not rise; the first is of scan {still[0] + 1}, "
                     f"{steps[still[0]]:g} s after the one before")
    if len(rising) and np.median(rising) > SPARSEST:
        lines.append(f"its scans are {np.median(rising):g} s apart; times must be in seconds")
    return lines


def load_log(path: str) -> RecordedLog:
    """Read a log.

    Its arrays are t (N, seconds), odom (N, 3), ranges (N, B), angle_min, angle_increment; ref (N, 3), laser_pose (3),
    range_min and range_max where it has them.

    Raises:
        OSError: The file cannot be opened.
        LogError: It is no .npz file, or an array is missing or of a wrong shape.
    """
    try:
        with files.open_regular(path, LARGEST_LOG) as stream:
            _require_size(stream)
            with np.load(stream, allow_pickle=False) as file:
                arrays = {name: np.asarray(file[name], dtype=float) for name in file.files if name in _KNOWN}
    except (ValueError, zipfile.BadZipFile, zlib.error, AttributeError, EOFError, SyntaxError, NotImplementedError,
            RuntimeError, MemoryError, LookupError, TypeError, struct.error, tokenize.TokenError) as error:
        raise LogError(f"log {path} is no .npz file of numbers: {error}") from error
    for name in ("t", "odom", "ranges", "angle_min", "angle_increment"):
        if name not in arrays:
            raise LogError(
                f"log {path} has no array '{name}'; it must have t, odom, ranges, angle_min, angle_increment"
            )
    count = arrays["t"].size
    shapes = {"t": (count,), "odom": (count, 3), "ref": (count, 3)}
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            raise LogError(f"array '{name}' of log {path} has shape {arrays[name].shape}; it must have {shape}")
    if arrays["ranges"].ndim != 2 or len(arrays["ranges"]) != count or arrays["ranges"].size == 0:
        raise LogError(
            f"array 'ranges' of log {path} has shape {arrays['ranges'].shape}; it must have "
            + (f"({count}, beams)" if count else "a scan")
        )
    _check_numbers(path, arrays)
    laser = arrays.get("laser_pose", np.zeros(3)).ravel()
    if laser.shape != (3,) or not np.isfinite(laser).all():
        raise LogError(f"array 'laser_pose' of log {path} is {laser.tolist()}; it must be x, y, yaw")
    return RecordedLog(
        arrays["t"], arrays["odom"], arrays["ranges"], float(arrays["angle_min"]), float(arrays["angle_increment"]),
        float(arrays["range_max"]) if "range_max" in arrays else guess_range_max(arrays["ranges"]), arrays.get("ref"),
        Pose2D(*map(float, laser)), float(arrays.get("range_min", 0.0)),
    )


def _check_numbers(path: str, arrays: Dict[str, np.ndarray]) -> None:
    """Raise LogError for invalid angles or ranges, and for odometry or reference too far from the origin."""
    for name in ("angle_min", "angle_increment", "range_min", "range_max"):
        value = arrays.get(name)
        if value is not None and value.size != 1:
            raise LogError(f"'{name}' of log {path} has shape {value.shape}; it must be one number")
    start, step = float(arrays["angle_min"]), float(arrays["angle_increment"])
    if not (abs(start) <= LARGEST_ANGLE and 0.0 < abs(step) <= LARGEST_ANGLE):
        raise LogError(
            f"angle_min and angle_increment of log {path} are {start} and {step}; they must be finite radians, the "
            "second not 0"
        )
    if "range_max" in arrays and not float(arrays["range_max"]) > 0.0:
        raise LogError(f"'range_max' of log {path} is {float(arrays['range_max'])}; it must be metres above 0")
    nearest, farthest = float(arrays.get("range_min", 0.0)), float(arrays.get("range_max", np.inf))
    if not 0.0 <= nearest < farthest:
        raise LogError(f"'range_min' of log {path} is {nearest}; it must be metres, 0 or more and below range_max")
    for name in ("odom", "ref"):
        values = np.abs(arrays[name][np.isfinite(arrays[name])]) if name in arrays else np.empty(0)
        if (values > FARTHEST).any():
            raise LogError(f"array '{name}' of log {path} goes to {values.max():.3g} m; at most is {FARTHEST:.0g}")


def _require_size(stream: BinaryIO) -> None:
    """Raise ValueError where a log unpacks to more than LARGEST_LOG."""
    with zipfile.ZipFile(stream) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_LOG:
        raise ValueError(f"it unpacks to {size} bytes; at most {LARGEST_LOG} are read")
    stream.seek(0)


_KNOWN = ("t", "odom", "ranges", "angle_min", "angle_increment", "ref", "laser_pose", "range_min", "range_max")


def save_log(path: str, log: RecordedLog) -> None:
    """Write a log in the form `load_log` reads; OSError where it cannot be written."""
    arrays: Dict[str, Any] = dict(
        t=log.times, odom=log.odom, ranges=log.ranges, angle_min=log.angle_min, angle_increment=log.angle_increment,
        range_min=log.range_min, range_max=log.range_max, laser_pose=np.array(log.laser_pose),
    )
    if log.reference is not None:
        arrays["ref"] = log.reference
    with whole_file(path) as file:
        np.savez_compressed(file, **arrays)


def guess_range_max(ranges: np.ndarray) -> float:
    """Return the range (m) from which on readings are invalid, for logs without range_max; ranges of any shape (m).

    Sensors report "nothing came back" as one fixed high value, or as several (81.83, 81.91). So the highest values are
    cut off as long as each is shared by many readings; where none is, the highest reading is the limit.
    """
    readings = ranges[np.isfinite(ranges)]
    readings = readings[readings > 0.0]
    if readings.size == 0:
        return 1.0
    values, counts = np.unique(np.round(readings, 2), return_counts=True)
    limit, crowd = float(values[-1]), max(3.0, CROWDED * readings.size)
    for index in range(len(values) - 1, -1, -1):
        if values[index] < limit - 0.5:
            break  # a gap: what follows are distances
        if counts[index] >= crowd or index == len(values) - 1:
            limit = float(values[index])
    return limit - 0.01 if limit > 0.02 else limit
