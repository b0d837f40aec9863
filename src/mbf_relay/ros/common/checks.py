"""The door: what messages from outside must keep before anything is built from them.

Of this time, finite, within what robots and floors measure, and of the size they say. One function per message; each
returns nothing and raises InvalidMessage, whose one line has the value and what is allowed.
"""

from __future__ import annotations

import math
from typing import Any, Optional

import numpy as np

from mbf_relay.geometry import FARTHEST, FASTEST, Twist2D
from mbf_relay.maps import COARSEST, FINEST, too_large
from mbf_relay.scan_monitor import LARGEST_GAP

LONGEST_FRAME = 256
"""Characters of a frame's name; each line about a goal or a message repeats it."""
AHEAD = 2.5
"""Seconds a stamp may be ahead of the clock: amcl post-dates its transform by up to 2 s, as upstream's range allows."""
CLOCKS_DIFFER = "two clocks differ, as those of two computers, or simulated time and the wall's"
"""What both a stamp ahead of the clock tells, and one that is old when it comes."""
TF2_END = 2 ** 31 - 1000
"""Seconds from which tf2 ends the process, less what its caches add to a stamp."""
LONGEST_RANGE = 1e4
"""Metres that a range sensor may claim to reach."""
FIRST_RANGE = 10.0
"""Metres within which a range sensor must begin to see: the nearest it tells, in millimetres, is ten times as far."""
NEAREST_READING = 100.0
"""Metres within which a scan with readings must have one: in millimetres, that is nearer than any robot's own hull."""
MOST_BEAMS = 100000
"""Beams of a scan: a hundred times what planar lidars have."""
MOST_ANGLE = 4.0 * math.pi
"""Radians: no lidar looks farther round than that, nor begins there."""
MOST_POINTS = 4000000
"""Points of a cloud: four megapixels of a depth camera."""
MOST_POSES = 1000000
"""Poses of a path: 50 km at 5 cm."""


class InvalidMessage(ValueError):
    """A message holds values that mean nothing; the text names them."""


def check_finite(**values: float) -> None:
    """Refuse numbers, by their names, that are infinite or none."""
    for name, value in values.items():
        if not math.isfinite(value):
            raise InvalidMessage(f"{name} is {value}; it must be finite")


def check_place(*place: float) -> None:
    """Refuse a position (m) that is not finite or farther away than anything navigated to."""
    if not all(abs(value) <= FARTHEST for value in place):  # False for NaN
        raise InvalidMessage(f"position {place} is not within {FARTHEST:g} m of its frame's origin")


def check_velocity(velocity: Twist2D) -> None:
    """Refuse a velocity (m/s, rad/s) that is not finite or faster than any robot."""
    if not velocity.is_a_robots():
        raise InvalidMessage(f"velocity {tuple(velocity)} is not finite or above {FASTEST:g} m/s or rad/s")


def why_old(age: float, came: float) -> str:
    """Return what to add where something is refused as too old: nothing, or why it was so when it came.

    Args:
        age: How long ago it was measured (s), by its stamp.
        came: How long ago it came (s).
    """
    return f"; it was so when it came: {CLOCKS_DIFFER}, or the way between them is slow" if came < 0.5 * age else ""


def check_time(stamp: float) -> None:
    """Refuse a stamp (s) that no clock of ROS shows, and tf2 would not survive."""
    if not 0.0 <= stamp < TF2_END:
        raise InvalidMessage(f"its stamp {stamp:.2f} s is no time a clock of ROS shows")


def check_stamp(stamp: float, now: float, max_age: Optional[float] = None) -> None:
    """Refuse what is not of this time.

    Args:
        stamp: When it was measured (s); 0 stands for now, as in tf.
        now: The clock (s).
        max_age: Oldest age (s) that is still news; None where its user judges that.
    """
    check_time(stamp)
    if stamp - now > AHEAD:
        raise InvalidMessage(
            f"its stamp {stamp:.2f} s is {stamp - now:.2f} s ahead of the clock; at most {AHEAD} s allowed: "
            + CLOCKS_DIFFER)
    if max_age is not None and stamp > 0.0 and now - stamp > max_age:
        raise InvalidMessage(f"its stamp {stamp:.2f} s is {now - stamp:.2f} s old; at most {max_age:g} s allowed")


def check_frames(*names: str) -> None:
    """Refuse names that no frame can have: empty or endless ones, and those with a NUL, which tf2, being C, ends at."""
    for name in names:
        if not name.strip("/") or "\0" in name or len(name) > LONGEST_FRAME:
            raise InvalidMessage(f"{shown(name)!r} names no frame")


def check_frame_is(wanted: str, name: str) -> None:
    """Refuse another frame than the one wanted, which an empty name stands for."""
    if name.lstrip("/") not in ("", wanted):
        raise InvalidMessage(f"frame '{shown(name)}'; it must be '{wanted}'")


def shown(name: str) -> str:
    """Return a frame's name as a line of a log bears it."""
    return name if len(name) <= LONGEST_FRAME else f"{name[:40]}... ({len(name)} characters)"


def quaternion_length(quaternion: Any) -> float:
    """Return the length of a quaternion, 1 where it is a rotation; infinite or NaN where a component is."""
    return math.hypot(quaternion.x, quaternion.y, quaternion.z, quaternion.w)


def check_scan(message: Any) -> None:
    """Refuse a LaserScan without sense; what its readings are worth is judged by `scan_monitor`."""
    beams = len(message.ranges)
    if len(message.header.frame_id) > LONGEST_FRAME:
        raise InvalidMessage(f"{shown(message.header.frame_id)!r} names no frame")
    if not 0 < beams <= MOST_BEAMS:
        raise InvalidMessage(f"scan of {beams} beams; it must have 1 to {MOST_BEAMS}")
    # far from 0 one float stands for the angles of many beams
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
    """Refuse readings (m), shape (B,), of which even the nearest is so far that they must be millimetres.

    What stands in all beams alike is no reading but a driver's word for "nothing".
    """
    told = ranges[np.isfinite(ranges)]  # first: numpy 1.17 warns of every comparison with what is no number
    told = told[told > 0.0]
    if len(told) and told.min() > NEAREST_READING and told.min() < told.max():
        raise InvalidMessage(
            f"scan whose nearest reading is {told.min():g} m; one within {NEAREST_READING:g} m is needed: are its "
            "ranges in metres?")


def _check_directions(message: Any, beams: int) -> None:
    """Refuse a scan whose beams do not look where it says they do: what they leave out would count as free.

    Fewer beams than said by less than a gap there may be are what a motor does that runs fast. An angle_max of 0 may
    have been left alone by the driver.
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
    """Refuse a PointCloud2 that is larger than what it holds, or larger than anybody needs."""
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

    No gap is told by a row_step left at 0, and none follows the only row of a cloud: there costmap_2d, which never
    looks at it, sees with whatever the driver wrote.
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
    """Refuse a list, named in the plural, that is longer than `most`."""
    if count > most:
        raise InvalidMessage(f"{count} {what}; at most {most} are taken")
