// What is known of the robot, as the batches bring it: metres and radians in the map frame, speed as m/s and rad/s.

import { inflate, points } from "./batch.js";
import { mapPaint, PAINTS } from "./colours.js";
import { Grid } from "./grid.js";

const TRAIL = 4000, TRAIL_STEP = 0.03, JUMP = 0.3;  // points, m, m

export class Scene {
  constructor(colours) {
    this.clear(colours);
  }

  clear(colours) {
    this.colours = colours;
    this.grids = {
      map: new Grid(mapPaint(colours)), global_costmap: new Grid(PAINTS.global_costmap()), local_costmap: new Grid(PAINTS.local_costmap()),
    };
    this.points = {};
    this.robot = { pose: null, speed: [0, 0], frames: {} };
    this.outlines = [];
    this.trail = [];
    this.goal = null;
    this.tour = null;
  }

  recolour(colours) {
    this.colours = colours;
    this.grids.map.recolour(mapPaint(colours));
  }

  async take({ header, payload }) {
    const name = header.layer;
    if (name in this.grids) this.grids[name].take(header, await inflate(payload));
    else if (name === "robot") this.takeRobot(header);
    else if (name === "obstacles") this.outlines = header.outlines;
    else if (name === "state") {
      this.goal = header.goal.goal;
      this.tour = header.tour;
    } else if ("count" in header) this.points[name] = points({ header, payload });
  }

  takeRobot(robot) {
    this.robot = robot;
    if (!robot.pose) return;
    const [x, y] = robot.pose, now = performance.now(), last = this.trail[this.trail.length - 1];
    const way = last ? Math.hypot(x - last[0], y - last[1]) : 0;
    if (last && way < TRAIL_STEP) return;
    const speed = Math.max(Math.abs(robot.speed[0]), Math.abs(this.trailSpeed || 0));
    const jumped = way > JUMP + 2 * speed * (now - this.trailTime) / 1000;  // believed elsewhere, not driven there
    this.trail.push([x, y, jumped]);
    this.trailTime = now;
    this.trailSpeed = robot.speed[0];
    if (this.trail.length > TRAIL) this.trail.splice(0, TRAIL / 10);
  }
}
