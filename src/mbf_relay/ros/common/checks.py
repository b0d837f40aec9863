"""Validation of incoming messages, before anything is built from them.

Stamps must be current, numbers finite and plausible for a ground robot, and arrays as long as their headers say. Each
`check_...` function returns nothing and raises InvalidMessage, whose one line has the value and what is allowed.
"""

from __future__ import annotations

import math
from typing import Any, Optional

import numpy as np

from mbf_relay.geometry import FARTHEST, FASTEST, Twist2D
from mbf_relay.maps import COARSEST, FINEST, too_large
from mbf_relay.scan_monitor import LARGEST_GAP

LONGEST_FRAME = 256
"""Characters a frame's name may have: log lines about goals and messages repeat it."""
AHEAD = 2.5
"""Seconds a stamp may be ahead of the clock: amcl's transform_tolerance, up to 2 s, dates map → odom ahead."""
CLOCKS_DIFFER = "two clocks differ, as those of two computers, or simulated time and the wall's"
"""Explanation in errors, for a stamp ahead of the clock and for one that was old when it arrived."""
TF2_END = 2 ** 31 - 1000
"""Stamps (s) from which on tf2's C++ core aborts the process, less a margin for the cache time it adds to a stamp."""
LONGEST_RANGE = 1e4
"""Metres to which a lidar's range_max is cut."""
FIRST_RANGE = 10.0
"""Largest range_min (m) of a lidar. A driver that publishes millimetres has at least a hundred here."""
NEAREST_READING = 100.0
"""Metres below which the nearest reading of a scan must be. Read as millimetres, 100 would lie inside the robot's hull:
a scan without any nearer reading is in millimetres."""
MOST_BEAMS = 100000
"""Beams a scan may have: a hundred times what planar lidars have."""
MOST_ANGLE = 4.0 * math.pi
"""Largest magnitude (rad) of angle_min."""
MOST_POINTS = 4000000
"""Points a cloud may have: a depth camera of four megapixels."""
MOST_POSES = 1000000
"""Poses a path may have: 50 km at 5 cm."""


class InvalidMessage(ValueError):
    """A message has invalid values; the text names them."""


def check_finite(**values: float) -> None:
    """Refuse numbers, given as name=value, that are infinite or NaN."""
    for name, value in values.items():
        if not math.isfinite(value):
            raise InvalidMessage(f"{name} is {value}; it must be finite")


def check_place(*place: float) -> None:
    """Refuse coordinates (m) that are not finite or beyond FARTHEST."""
    if not all(abs(value) <= FARTHEST for value in place):  # False for NaN
        raise InvalidMessage(f"position {place} is not within {FARTHEST:g} m of its frame's origin")


def check_velocity(velocity: Twist2D) -> None:
    """Refuse a velocity (m/s, rad/s) that is not finite or beyond FASTEST."""
    if not velocity.is_a_robots():
        raise InvalidMessage(f"velocity {tuple(velocity)} is not finite or above {FASTEST:g} m/s or rad/s")


def why_old(age: float, came: float) -> str:
    """Return what to add to the error about a message that is too old: empty, or that it was old when it arrived.

    Args:
        age: Age (s) by its stamp.
        came: Time (s) since it arrived.
    """
    return f"; it was so when it came: {CLOCKS_DIFFER}, or the way between them is slow" if came < 0.5 * age else ""


def check_time(stamp: float) -> None:
    """Refuse a stamp (s) that ROS time cannot have, or at which tf2 would abort the process."""
    if not 0.0 <= stamp < TF2_END:
        raise InvalidMessage(f"its stamp {stamp:.2f} s is no time a clock of ROS shows")


def check_stamp(stamp: float, now: float, max_age: Optional[float] = None) -> None:
    """Refuse a stamp that is too far ahead of the clock, or too old.

    Args:
        stamp: Time (s) of the measurement; 0 stands for now, as in tf.
        now: ROS time (s).
        max_age: Largest age (s); None for no limit.
    """
    check_time(stamp)
    if stamp - now > AHEAD:
        raise InvalidMessage(
            f"its stamp {stamp:.2f} s is {stamp - now:.2f} s ahead of the clock; at most {AHEAD} s allowed: "
            + CLOCKS_DIFFER)
    if max_age is not None and stamp > 0.0 and now - stamp > max_age:
        raise InvalidMessage(f"its stamp {stamp:.2f} s is {now - stamp:.2f} s old; at most {max_age:g} s allowed")


def check_frames(*names: str) -> None:
    """Refuse frame names that are empty, too long, or have a NUL character, at which tf2's C strings end."""
    for name in names:
        if not name.strip("/") or "\0" in name or len(name) > LONGEST_FRAME:
            raise InvalidMessage(f"{shown(name)!r} names no frame")


def check_frame_is(wanted: str, name: str) -> None:
    """Refuse a frame other than `wanted`; an empty name stands for `wanted`."""
    if name.lstrip("/") not in ("", wanted):
        raise InvalidMessage(f"frame '{shown(name)}'; it must be '{wanted}'")


def shown(name: str) -> str:
    """Return a frame's name for a log line, shortened where it is too long."""
    return name if len(name) <= LONGEST_FRAME else f"{name[:40]}... ({len(name)} characters)"


def quaternion_length(quaternion: Any) -> float:
    """Return the norm of a quaternion, 1 for a rotation; infinite or NaN where a component is."""
    return math.hypot(quaternion.x, quaternion.y, quaternion.z, quaternion.w)


def check_scan(message: Any) -> None:
    """Refuse a LaserScan with invalid frame, angles or limits; `check_readings` and `scan_monitor` judge its ranges."""
    beams = len(message.ranges)
    if len(message.header.frame_id) > LONGEST_FRAME:
        raise InvalidMessage(f"{shown(message.header.frame_id)!r} names no frame")
    if not 0 < beams <= MOST_BEAMS:
        raise InvalidMessage(f"scan of {beams} beams; it must have 1 to {MOST_BEAMS}")
    # a huge angle_min leaves float32 angles no resolution between beams
    if not (abs(message.angle_min) <= MOST_ANGLE and abs(message.angle_increment) * beams <= 4.0 * math.pi):
        raise InvalidMessage(
            f"scan of {beams} beams from angle {message.angle_min} by {message.angle_increment} rad; "
            f"they must be at most {MOST_ANGLE:.1f} rad, and two turns of all beams together")
    _check_directions(message, beams)
    if not 0.0 <= message.range_min < message.range_max:
        raise InvalidMessage(
            f"scan with range_min {message.range_min} m and range_max {message.range_max} m; "
            "they must be 0 <= range_min < range_max")
    if message.range_min > FIRST_RANGE:
        raise InvalidMessage(
            f"scan with range_min {message.range_min} m, which shows nothing nearer; at most {FIRST_RANGE:g} m are "
            "taken: are its ranges in metres?")


def check_readings(ranges: np.ndarray) -> None:
    """Refuse ranges (m), shape (B,), that must be in millimetres, because even the nearest is beyond NEAREST_READING.

    One value in all beams is taken for the driver's way to say "nothing seen".
    """
    told = ranges[np.isfinite(ranges)]  # first, because numpy 1.17 warns of comparisons with NaN
    told = told[told > 0.0]
    if len(told) and told.min() > NEAREST_READING and told.min() < told.max():
        raise InvalidMessage(
            f"scan whose nearest reading is {told.min():g} m; one within {NEAREST_READING:g} m is needed: are its "
            "ranges in metres?")


def _check_directions(message: Any, beams: int) -> None:
    """Refuse a scan whose number of beams and increment do not lead from angle_min to angle_max.

    What the beams do not cover would count as free. Missing beams up to LARGEST_GAP are accepted: a lidar whose motor
    runs fast has fewer. An angle_max of 0 against the sense of the increment counts as not filled in.
    """
    step = message.angle_increment
    said = math.copysign(1.0, step) * (message.angle_max - message.angle_min)
    covered = abs(step) * (beams - 1)
    says = f"it says they look from angle {message.angle_min} to {message.angle_max}"
    if (step == 0.0 and beams > 1) or said - covered > LARGEST_GAP:
        raise InvalidMessage(f"scan of {beams} beams by {step} rad, which cover {covered:.2f} rad; {says}")
    if said < -LARGEST_GAP and message.angle_max != 0.0:
        raise InvalidMessage(f"scan of {beams} beams by {step} rad, against where {says}")


def check_cloud(message: Any) -> None:
    """Refuse a PointCloud2 that has too many points, or whose layout does not fit its data."""
    count, step = message.width * message.height, message.point_step
    if not 0 <= count <= MOST_POINTS:
        raise InvalidMessage(
            f"point cloud of {message.height} x {message.width} points; at most {MOST_POINTS} are taken"
        )
    ends = [
        field.offset + (8 if field.datatype == 8 else 4) for field in message.fields if field.name in ("x", "y", "z")
    ]
    if step < max(ends, default=1):
        raise InvalidMessage(f"point cloud of {step} bytes a point with coordinates up to byte {max(ends, default=1)}")
    rows = row_step(message)
    if rows * message.height > len(message.data) or step * message.width > rows:
        raise InvalidMessage(
            f"point cloud of {message.height} rows of {rows} bytes with {len(message.data)} bytes of data; "
            f"its {message.width} points a row take {step * message.width}")


def row_step(message: Any) -> int:
    """Return the bytes from one row of a PointCloud2 to the next.

    Rows are taken as packed where row_step is 0, and where there is but one: costmap_2d never reads row_step, so that
    drivers with any value there work with it.
    """
    packed: int = message.point_step * message.width
    return packed if message.height == 1 else message.row_step or packed


def check_map(info: Any, cells: int) -> None:
    """Refuse a map by its MapMetaData and the number of cells that came with it."""
    if info.width == 0 or info.height == 0 or cells != info.width * info.height:
        raise InvalidMessage(
            f"map of {info.width} x {info.height} cells with {cells} values: it must have width x height, and some")
    trouble = too_large(info.width, info.height)
    if trouble:
        raise InvalidMessage(f"map of {trouble}")
    if not FINEST <= round(info.resolution, 9) <= COARSEST:
        raise InvalidMessage(f"map with a resolution of {info.resolution} m; it must be {FINEST:g} to {COARSEST:g} m")


def check_count(count: int, most: int, what: str) -> None:
    """Refuse a list that is longer than `most`; `what` names its elements, in the plural, for the error."""
    if count > most:
        raise InvalidMessage(f"{count} {what}; at most {most} are taken")
