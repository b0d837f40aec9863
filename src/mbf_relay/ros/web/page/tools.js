// What a press, a drag, a pinch and the keys do on the map.

const CLICK = 8;  // pixels below which a drag is a click

export class Tools {
  // `robot` returns the robot's pose, or null. `on` holds functions: placed(tool, [x, y, heading]) with metres and
  // radians in the map frame, changed(): draw anew, moved(): the view was moved by hand.
  constructor(canvas, camera, sketch, robot, on) {
    Object.assign(this, { canvas, camera, sketch, robot, on });
    this.tool = "look";
    this.pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  take(tool) {
    this.tool = tool;
    this.sketch.arrow = this.start = null;  // a drag is that of the tool it began with
    this.canvas.dataset.tool = tool;
    this.on.changed();
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  down(event) {
    if (this.pointers.size >= 2) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.place(event));
    if (this.pointers.size === 2) {  // a pinch, whatever the tool
      this.sketch.arrow = this.start = null;
      this.on.changed();
    } else if (this.tool !== "look" && event.button === 0) {
      this.start = this.place(event);
      this.aim(this.start);
    }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = this.place(event);
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
      const spread = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
      this.camera.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
      this.camera.zoom(spread(now, other) / spread(before, other), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      this.on.moved();
    } else if (this.start) this.aim(now);
    else {
      this.camera.pan(now[0] - before[0], now[1] - before[1]);
      this.on.moved();
    }
    this.pointers.set(event.pointerId, now);
    this.on.changed();
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    const { start } = this, arrow = this.sketch.arrow;
    this.start = this.sketch.arrow = null;
    if (start && arrow && event.type === "pointerup") this.on.placed(this.tool, arrow);
    this.on.changed();
  }

  // A click without a drag looks the way the robot comes.
  aim(now) {
    const [x, y] = this.camera.toMap(...this.start), dragged = Math.hypot(now[0] - this.start[0], now[1] - this.start[1]) > CLICK;
    const pose = this.robot();
    let heading = pose ? pose[2] : 0;
    if (dragged) heading = Math.atan2(this.start[1] - now[1], now[0] - this.start[0]);
    else if (pose && this.tool !== "pose" && Math.hypot(x - pose[0], y - pose[1]) > 0.3) heading = Math.atan2(y - pose[1], x - pose[0]);
    this.sketch.arrow = [x, y, heading];
    this.on.changed();
  }

  wheel(event) {
    event.preventDefault();
    this.camera.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), ...this.place(event));
    this.on.moved();
    this.on.changed();
  }

  key(event) {
    const pan = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] }[event.key];
    const zoom = { "+": 1.25, "=": 1.25, "-": 0.8 }[event.key];
    if (pan) this.camera.pan(...pan);
    else if (zoom) this.camera.zoom(zoom);
    else return;
    event.preventDefault();
    this.on.moved();
    this.on.changed();
  }
}
