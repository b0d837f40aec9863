// Draws the scene. The context is in metres, y up; lines and marks are given their width in pixels. A canvas reckons in
// single precision, by which a map in UTM coordinates is half a metre off: x and y of the map count from `base` there.

import { COSTS } from "./colours.js";

const STEP = 1000;  // metres from one possible base to the next

export class Painter {
  constructor(canvas, camera) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.camera = camera;
    this.base = [0, 0];
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas, ratio = Math.min(2, devicePixelRatio || 1);
    this.camera.width = width;
    this.camera.height = height;
    this.ratio = ratio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
  }

  draw(scene, shown, sketch) {
    const { context, camera, ratio } = this, { colours } = scene;
    const zoom = camera.scale * ratio;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = colours["map-unknown"];
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    const base = this.base = [camera.x, camera.y].map((middle) => STEP * Math.round(middle / STEP));
    context.setTransform(zoom, 0, 0, -zoom, this.canvas.width / 2 - (camera.x - base[0]) * zoom, this.canvas.height / 2 + (camera.y - base[1]) * zoom);
    this.pixel = 1 / camera.scale;
    context.imageSmoothingEnabled = zoom < 20;  // cells shall be cells once they are larger than a dot
    context.lineJoin = context.lineCap = "round";

    for (const name of ["map", "global_costmap", "local_costmap"]) if (shown.has(name)) this.grid(scene, name);
    if (shown.has("grid")) this.lines(colours.grid);
    if (shown.has("trail")) this.polyline(scene.trail, colours.trail, 2);
    if (shown.has("obstacles")) for (const outline of scene.outlines) this.area(outline, colours.warn, 0.35);
    const points = scene.points;
    if (shown.has("trajectories") && points.trajectories) this.costs(points.trajectories);
    if (shown.has("particles") && points.particles) this.poses(points.particles, colours.particles);
    if (shown.has("global_plan") && points.global_plan) this.path(points.global_plan, colours.plan, 2.5);
    if (shown.has("local_plan") && points.local_plan) this.path(points.local_plan, colours.local, 4);
    if (shown.has("scan") && points.scan) this.dots(points.scan, colours.scan, 3.2);
    if (shown.has("queue") && scene.tour) this.waypoints(scene.tour.waypoints, scene.tour.index, colours);
    if (sketch.waypoints.length && !scene.tour) this.waypoints(sketch.waypoints, -1, colours);
    if (scene.goal) this.flag(scene.goal, colours.goal);
    if (shown.has("others")) for (const pose of Object.values(scene.robot.others || {})) if (pose) this.robot(pose, colours.faint, colours.surface);
    if (shown.has("footprint") && points.footprint) this.outline(points.footprint, colours.ink);
    if (scene.robot.pose) this.robot(scene.robot.pose, colours.robot, colours.surface);
    if (sketch.arrow) this.sketch(sketch, colours);
  }

  grid(scene, name) {
    const grid = scene.grids[name];
    if (!grid.shape) return;
    const { frame, origin } = grid.shape, place = scene.robot.frames[frame];
    if (place === null) return;  // nobody knows where
    const [x, y, turn] = place || [0, 0, 0];
    const cosine = Math.cos(turn), sine = Math.sin(turn);
    const corner = [x + cosine * origin[0] - sine * origin[1], y + sine * origin[0] + cosine * origin[1], turn + origin[2]];
    this.at(corner, (context) => grid.render(context));
  }

  move(x, y) { this.context.moveTo(x - this.base[0], y - this.base[1]); }

  line(x, y) { this.context.lineTo(x - this.base[0], y - this.base[1]); }

  square(x, y, side) { this.context.rect(x - this.base[0] - side / 2, y - this.base[1] - side / 2, side, side); }

  lines(colour) {
    const { camera } = this;
    const step = [0.1, 0.5, 1, 5, 10, 50, 100, 500, 1000].find((size) => size * camera.scale > 34) || 5000;
    const [left, top] = camera.toMap(0, 0), [right, bottom] = camera.toMap(camera.width, camera.height);
    this.context.beginPath();
    for (let x = Math.ceil(left / step) * step; x < right; x += step) { this.move(x, bottom); this.line(x, top); }
    for (let y = Math.ceil(bottom / step) * step; y < top; y += step) { this.move(left, y); this.line(right, y); }
    this.stroke(colour, 1);
  }

  stroke(colour, width) {
    this.context.strokeStyle = colour;
    this.context.lineWidth = width * this.pixel;
    this.context.stroke();
  }

  polyline(list, colour, width) {
    if (list.length < 2) return;
    this.context.beginPath();
    for (const [x, y, jumped] of list) this[jumped === true ? "move" : "line"](x, y);
    this.stroke(colour, width);
  }

  path({ values, columns }, colour, width) {
    this.context.beginPath();
    for (let i = 0; i < values.length; i += columns) this.line(values[i], values[i + 1]);
    this.stroke(colour, width);
  }

  outline({ values, columns }, colour) {
    if (!values.length) return;
    this.context.beginPath();
    for (let i = 0; i < values.length; i += columns) this.line(values[i], values[i + 1]);
    this.context.closePath();
    this.stroke(colour, 1.5);
  }

  area(corners, colour, share) {
    this.context.beginPath();
    for (const [x, y] of corners) this.line(x, y);
    this.context.closePath();
    this.context.globalAlpha = share;
    this.context.fillStyle = colour;
    this.context.fill();
    this.context.globalAlpha = 1;
    this.stroke(colour, 1.5);
  }

  dots({ values, columns }, colour, size) {
    const side = size * this.pixel;
    this.context.fillStyle = colour;
    this.context.beginPath();
    for (let i = 0; i < values.length; i += columns) this.square(values[i], values[i + 1], side);
    this.context.fill();
  }

  costs({ values, columns }) {
    const side = 2.4 * this.pixel;
    COSTS.forEach((colour, level) => {
      this.context.fillStyle = colour;
      this.context.beginPath();
      for (let i = 0; i < values.length; i += columns) {
        if (Math.min(COSTS.length - 1, Math.floor(values[i + 2] * COSTS.length)) === level) {
          this.square(values[i], values[i + 1], side);
        }
      }
      this.context.fill();
    });
  }

  poses({ values, columns }, colour) {
    const length = Math.max(0.06, 7 * this.pixel);
    this.context.beginPath();
    for (let i = 0; i < values.length; i += columns) {
      this.move(values[i], values[i + 1]);
      this.line(values[i] + length * Math.cos(values[i + 2]), values[i + 1] + length * Math.sin(values[i + 2]));
    }
    this.context.globalAlpha = 0.55;
    this.stroke(colour, 1.2);
    this.context.globalAlpha = 1;
  }

  at([x, y, heading], draw) {
    this.context.save();
    this.context.translate(x - this.base[0], y - this.base[1]);
    this.context.rotate(heading);
    draw(this.context);
    this.context.restore();
  }

  robot(pose, fill, edge) {
    const size = Math.max(0.09, 10 * this.pixel);
    this.at(pose, (context) => {
      context.beginPath();
      context.moveTo(size * 1.25, 0);
      context.lineTo(-size, size * 0.85);
      context.lineTo(-size * 0.55, 0);
      context.lineTo(-size, -size * 0.85);
      context.closePath();
      context.fillStyle = fill;
      context.fill();
    });
    this.stroke(edge, 1.5);
  }

  flag(pose, colour) {
    const size = Math.max(0.1, 12 * this.pixel);
    this.at(pose, (context) => {
      context.beginPath();
      context.arc(0, 0, size * 0.5, 0, 2 * Math.PI);
      context.moveTo(0, 0);
      context.lineTo(size * 1.6, 0);
      context.lineTo(size * 1.15, size * 0.35);
      context.moveTo(size * 1.6, 0);
      context.lineTo(size * 1.15, -size * 0.35);
    });
    this.stroke(colour, 3);
  }

  waypoints(list, index, colours) {
    if (list.length > 1) {
      this.context.setLineDash([6 * this.pixel, 6 * this.pixel]);
      this.polyline(list, colours.goal, 1.5);
      this.context.setLineDash([]);
    }
    list.forEach((pose, number) => {
      this.flag(pose, number === index ? colours.goal : colours.faint);
      this.label(pose, String(number + 1), colours);
    });
  }

  label([x, y], words, colours) {
    const { context, ratio, camera } = this, [column, row] = camera.toScreen(x, y);
    context.save();
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = "600 12px system-ui, sans-serif";
    context.lineWidth = 3;
    context.strokeStyle = colours["map-free"];
    context.fillStyle = colours.ink;
    context.strokeText(words, column + 9, row - 9);
    context.fillText(words, column + 9, row - 9);
    context.restore();
  }

  sketch({ arrow, colour, radius, square }, colours) {
    const paint = colours[colour];
    if (square) {
      const half = square / 2, [x, y] = arrow;
      this.area([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]], paint, 0.35);
      return;
    }
    if (radius) {
      this.context.beginPath();
      this.context.arc(arrow[0] - this.base[0], arrow[1] - this.base[1], radius, 0, 2 * Math.PI);
      this.context.globalAlpha = 0.18;
      this.context.fillStyle = paint;
      this.context.fill();
      this.context.globalAlpha = 1;
      this.stroke(paint, 1);
    }
    this.flag(arrow, paint);
  }
}
