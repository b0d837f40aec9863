"""The last check of a velocity before the wheels: can the robot brake in front of everything that the lidars show?

It uses no costmap, goal or map. It keeps the newest scan of each lidar (told apart by frame), the velocities it has let
pass since, and an estimate of the delay of the wheels. A velocity passes unchanged while

- the clock runs, commands keep coming, and the newest scan of each lidar is fresh;
- the footprint, moved along the arc on which the robot reacts and brakes, keeps `margin` from every point of the scans;
  with a known wheel separation also along the spiral of a differential drive whose wheels both brake at once;
- the robot can stop within the field of view and range of a lidar.

Otherwise it is slowed down along the same arc, or stopped. Points that are within the margin already may not come
nearer, so that the robot can always drive away from them.

Where odometry shows a delay, the arc begins where the robot will be after it, since velocities that have passed cannot
be taken back. As the delay is an estimate, two more arcs must be free: one without delay, and one with the largest
delay that odometry cannot show.

The idea is that of Nav2's collision monitor, with the footprint on the braking arc in place of zones.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.control.blind_beams import blind_points
from mbf_relay.control.braking_check import MOST_STEPS, STEP, BrakingCheck
from mbf_relay.control.command_delay import LATE, LONGEST, CommandDelay, held_between, way_held
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.observation import scan_points
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.scan import LaserScan
from mbf_relay.senders import HOW_TO_GO_ON, Senders

OFF_ROBOT = 0.5
"""Distance (m) beyond the footprint's farthest corner at which a lidar cannot be the robot's own."""
MOVED = 0.05
"""Motion (m or rad) after which the readings of a working lidar must have changed."""

PASSING, STANDING = "passing", "standing"
SILENT, NO_SCAN, OBSTACLE, UNSEEN, NOT_FINITE = "silent sender", "no fresh scan", "obstacle", "unseen", "not finite"
NO_TIME = "no time"
"""Causes of a verdict."""


class Verdict(NamedTuple):
    """The velocity that may go to the wheels, the cause (see above), and a line for people."""

    velocity: Twist2D
    cause: str
    text: str


class Sight(NamedTuple):
    """The last scan of one lidar.

    Attributes:
        scan: Scan with angles counterclockwise as seen from above.
        laser_in_base: Pose of the lidar in the base frame.
        points: Obstacle points, shape (N, 2) in metres, in the base frame at the scan's time.
        measured: Number of points that were measured; those that follow are assumed, see `blind_points`.
        changed_at: Stamp (s) of the first scan with these readings, where the lidar may be frozen.
        nearest: Distance (m) of the nearest point from the base; infinite for no points.
        rides: Whether the lidar is mounted on the robot.
    """

    scan: LaserScan
    laser_in_base: Pose2D
    points: np.ndarray
    measured: int
    changed_at: float
    nearest: float
    rides: bool


class VelocityGuard:
    """Judges velocities by the newest scans. One thread at a time; `now` and stamps are of one clock.

    Attributes:
        delay: Estimate of the delay between commands and motion.
        time_stands: Whether the clock has stopped, so that ages of scans and commands mean nothing.
    """

    def __init__(self, parameters: VelocityGuardParameters) -> None:
        self._parameters = parameters
        self.set_outline(parameters.outline())
        self._asked, self._asked_at = STOP, -math.inf
        self.delay, self.time_stands = CommandDelay(), False
        self._seen: Dict[str, Sight] = {}  # by the lidar's frame
        self._lidars = Senders()
        self._passed: Deque[Tuple[float, Twist2D]] = deque([(-math.inf, STOP)])

    def set_outline(self, outline: np.ndarray) -> None:
        """Take the robot's outline, padded, shape (K, 2) in metres, from now on."""
        self._braking = BrakingCheck(self._parameters, outline)

    def take_command(self, now: float, velocity: Twist2D, moving: Optional[Twist2D] = None) -> None:
        """Note the velocity commanded at `now` (s), and the one measured by odometry, where known; both body frame."""
        self._asked, self._asked_at = velocity, now
        if moving is not None:
            self.delay.note(now, moving)

    def forget_command(self) -> None:
        """Forget the command, because its sender is gone."""
        self._asked_at = -math.inf

    def take_scan(self, scan: LaserScan, laser_in_base: Pose2D, rides: bool = True) -> None:
        """Take a scan (angles as seen from above), the lidar's pose, and whether the robot carries it.

        A scan with the same readings as the last one, although the robot has moved, is dropped: the lidar is frozen.
        """
        self._lidars.hear(scan.frame, scan.stamp, is_guest=not rides)
        changed_at = self._changed_at(scan)
        if changed_at is None:
            return
        points, hits = scan_points(scan)
        seen = laser_in_base.transform_points(points[hits])
        unseen = blind_points(scan, laser_in_base, self._parameters.blind_sector, self._braking.outline)
        points = np.vstack((seen, unseen))
        nearest = float(np.hypot(points[:, 0], points[:, 1]).min(initial=math.inf))
        self._seen[scan.frame] = Sight(scan, laser_in_base, points, len(seen), changed_at, nearest, rides)

    def _changed_at(self, scan: LaserScan) -> Optional[float]:
        """Return the stamp (s) of the first scan with these readings; None where the robot was commanded to move since.
        """
        last = self._seen.get(scan.frame)
        same = (
            last is not None
            and scan.ranges.tobytes() == last.scan.ranges.tobytes()
            and np.isfinite(scan.ranges).any()
        )
        if last is None or not same or self._asked == STOP:
            return scan.stamp
        late = self.delay.seconds
        moved = _moved(self._passed_between(last.changed_at - late, scan.stamp - late))
        return None if max(math.hypot(moved.x, moved.y), abs(moved.theta)) > MOVED else last.changed_at

    @property
    def _sights(self) -> List[Sight]:
        """The last scan of each lidar that sends, in the order in which they were first heard."""
        return [self._seen[frame] for frame in self._lidars.heard]

    def verdict(self, now: float) -> Verdict:
        """Return the velocity that may go to the wheels at `now` (s), and note it as sent."""
        found = self._judge(now)
        if now < self._passed[-1][0]:  # time was set back
            self._passed.clear()
            self._passed.append((-math.inf, STOP))
        if found.velocity != self._passed[-1][1]:
            self._passed.append((now, found.velocity))
            self.delay.tell(now, found.velocity)
        oldest = min((sight.changed_at for sight in self._sights), default=-math.inf)
        while len(self._passed) > 1 and self._passed[1][0] <= oldest - LONGEST:
            self._passed.popleft()
        return found

    def _judge(self, now: float) -> Verdict:
        asked, parameters = self._asked, self._parameters
        if not asked.is_finite():
            return Verdict(STOP, NOT_FINITE, f"stopped: velocity {tuple(asked)} is not finite")
        if asked == STOP:
            return Verdict(STOP, STANDING, "standing: no velocity is asked for")
        if self.time_stands:
            return Verdict(STOP, NO_TIME, f"stopped: simulated time stands at {now:.2f} s, by which nothing gets old")
        if not 0.0 <= now - self._asked_at <= parameters.input_timeout:
            return Verdict(
                STOP, SILENT, f"stopped: no velocity has come for {parameters.input_timeout:g} s, or its sender is gone"
            )
        sights = [self._seen[frame] for frame in self._lidars.present]  # one in the world may fall silent
        if not sights:
            return Verdict(STOP, NO_SCAN, "stopped: there is no scan yet")
        for sight in sights:
            age = now - sight.scan.stamp
            if not abs(age) <= parameters.scan_timeout:
                whose = f" in {sight.scan.frame}, one of {len(sights)} lidars," if len(sights) > 1 else ""
                old, why = f"is {age:.1f} s old", f"; {HOW_TO_GO_ON}" if whose else ""
                if age < 0.0:
                    old, why = f"is dated {-age:.1f} s ahead of the clock", ": two clocks differ"
                return Verdict(
                    STOP, NO_SCAN,
                    f"stopped: the newest scan{whose} {old}, at most {parameters.scan_timeout:g} s allowed{why}")
        return self._judge_by_scan(asked, now)

    def _judge_by_scan(self, asked: Twist2D, now: float) -> Verdict:
        sights = self._sights
        useless = self._why_useless(sights)
        if useless:
            return Verdict(STOP, UNSEEN, f"stopped: {useless}")
        share, in_the_way = 1.0, ""
        if not self._is_clear(asked, sights, now):
            for sight in sights:
                met = self._met_before(sight, now)
                if met is not None:
                    what = self._braking.something_at(met)
                    return Verdict(STOP, OBSTACLE, f"stopped: {what} is met by what passed already")
            share, in_the_way = self._braking.free_share(asked, self._points_ahead(sights, now))
            measured = [sight._replace(points=sight.points[:sight.measured]) for sight in sights]
            if in_the_way and not self._braking.in_the_way(asked, self._points_ahead(measured, now)):
                in_the_way += (", where the lidar measures nothing, so that something may touch the robot; "
                               "blind_sector: 0.0 is for drivers that say so of what is too far away")
        limit, unseen = max((self._share_in_sight(asked, sight) for sight in sights), key=lambda found: found[0])
        if not in_the_way and limit >= 1.0:
            return Verdict(asked, PASSING, "passing")
        if share <= limit:
            return _slowed(asked, share, OBSTACLE, in_the_way)
        return _slowed(asked, limit, UNSEEN, unseen)

    def _why_useless(self, sights: List[Sight]) -> str:
        """Return why lidars cannot show what is round the footprint: off the robot, or too short; empty if they can."""
        for sight in sights:
            off = math.hypot(*sight.laser_in_base[:2])
            if sight.rides and off > self._braking.radius + OFF_ROBOT:
                return (
                    f"the lidar in {sight.scan.frame} sits {off:.2f} m from {self._parameters.base_frame}, and the "
                    f"footprint reaches {self._braking.radius:.2f} m from there: one of the two is not the robot's")
        reach = max(math.hypot(*sight.laser_in_base[:2]) + sight.scan.range_max for sight in sights)
        if reach <= self._braking.inscribed_radius:
            return (
                f"the footprint reaches {self._braking.inscribed_radius:.2f} m to every side, and no lidar sees "
                f"farther than {reach:.2f} m")
        return ""

    def _is_clear(self, velocity: Twist2D, sights: List[Sight], now: float) -> bool:
        """Return whether all points are too far away to be reached, so that the footprint need not be checked."""
        reach, late = self._braking.reach(velocity), max(LATE, self.delay.seconds)
        return all(
            sight.nearest - sum(
                passed.speed() * seconds for passed, seconds in self._passed_between(sight.scan.stamp - late, now)
            ) > reach
            for sight in sights)

    def _points_ahead(self, sights: List[Sight], now: float) -> np.ndarray:
        """Return the points of scans in the base frame at which a command sent now takes effect, (N, 2) in metres.

        Each is there for every delay: none, the largest that odometry cannot show, and the estimated one.
        """
        return np.vstack([
            _moved(self._passed_between(sight.scan.stamp - delay, now)).inverse().transform_points(sight.points)
            for sight in sights for delay in {0.0, LATE, self.delay.seconds}])

    def _met_before(self, sight: Sight, now: float) -> Optional[np.ndarray]:
        """Return the first point (2,) touched by motion that was commanded already; None for none."""
        held = list(self._held(sight, now))
        step = max(STEP, sum(self._braking.way(velocity, seconds) for velocity, seconds in held) / MOST_STEPS)
        poses = way_held(IDENTITY, held, step, step / self._braking.radius)
        return self._braking.too_near(poses, sight.points, 0.0)

    def _held(self, sight: Sight, now: float) -> Iterator[Tuple[Twist2D, float]]:
        """Yield (velocity, duration in s) from the scan's time to where a command sent now takes effect."""
        return self._passed_between(sight.scan.stamp - self.delay.seconds, now)

    def _passed_between(self, stamp: float, now: float) -> Iterator[Tuple[Twist2D, float]]:
        """Return (velocity, duration in s) of what passed between two times (s), without standing."""
        return (held for held in held_between(self._passed, stamp, now) if held[0] != STOP)

    def _share_in_sight(self, asked: Twist2D, sight: Sight) -> Tuple[float, str]:
        """Return the largest share of a velocity from which the robot stops within a lidar's view and range, and why.
        """
        speed = asked.speed()
        if speed <= self._parameters.unseen_speed:  # or a turn on the spot, which leads nowhere
            return 1.0, ""
        least = self._parameters.unseen_speed / speed
        if self._is_unseen(asked, sight):
            return least, "no beam of the lidar looks where the robot is to go"
        p, ahead = self._parameters, np.array(asked[:2]) / speed
        front = float((self._braking.outline @ ahead).max())  # of the footprint (m)
        room = float(ahead @ sight.laser_in_base[:2]) + sight.scan.range_max - front
        braking = 0.5 * speed * self._braking.seconds(asked)  # way (m)
        reacting = speed * (p.reaction_time + self.delay.seconds)
        room = max(0.0, room)
        share = 2.0 * room / (reacting + math.sqrt(reacting * reacting + 4.0 * braking * room))
        return max(least, min(1.0, share)), (
            f"the lidar sees {room:.2f} m past the footprint, and the robot needs {reacting + braking:.2f} m to stop")

    def _is_unseen(self, asked: Twist2D, sight: Sight) -> bool:
        """Return whether the direction of motion is outside a lidar's field of view."""
        scan = sight.scan
        width = abs(scan.angle_increment) * (len(scan.ranges) + 1)
        if width >= 2.0 * math.pi:
            return False
        if width < self._parameters.blind_sector:  # a field of view below that is taken for none
            return True
        middle = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1) / 2.0
        off = math.atan2(asked.y, asked.x) - sight.laser_in_base.theta - middle
        return abs(math.remainder(off, 2.0 * math.pi)) > width / 2.0


def _moved(held: Iterable[Tuple[Twist2D, float]]) -> Pose2D:
    """Return the motion of velocities, each with its duration (s), as a pose in the frame of the start."""
    moved = IDENTITY
    for velocity, duration in held:
        moved = moved.compose(velocity.held(duration))
    return moved


def _slowed(asked: Twist2D, share: float, cause: str, why: str) -> Verdict:
    if share <= 0.0:
        return Verdict(STOP, cause, f"stopped: {why}")
    return Verdict(asked.scaled(share), cause, f"slowed down to {100.0 * share:.0f} %: {why}")
