// The driving stick: it drives only while it is held, and sends its place every PERIOD, forward and left from -1 to 1.

const PERIOD = 80;  // ms
const KEYS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

export class Stick {
  constructor(element, knob, send) {
    Object.assign(this, { element, knob, send });
    this.timer = 0;
    this.keys = new Set();
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this.follow(event);
    });
    element.addEventListener("pointermove", (event) => { if (element.hasPointerCapture(event.pointerId)) this.follow(event); });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) element.addEventListener(name, () => this.release());
    element.addEventListener("keydown", (event) => this.key(event, true));
    element.addEventListener("keyup", (event) => this.key(event, false));
    element.addEventListener("blur", () => this.release());
    addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
  }

  follow(event) {
    const box = this.element.getBoundingClientRect(), reach = box.width / 2 - 26;
    const limit = (value) => Math.max(-1, Math.min(1, value / reach));
    this.hold(limit(box.top + box.height / 2 - event.clientY), limit(box.left + box.width / 2 - event.clientX));
  }

  key(event, down) {
    if (!(event.key in KEYS)) return;
    event.preventDefault();
    if (down) this.keys.add(event.key);
    else this.keys.delete(event.key);
    if (!this.keys.size) return void this.release();
    const sum = [...this.keys].reduce(([f, l], key) => [f + KEYS[key][0], l + KEYS[key][1]], [0, 0]);
    this.hold(sum[0] * 0.7, sum[1] * 0.6);
  }

  hold(forward, left) {
    this.wish = { do: "stick", forward, left };
    const reach = this.element.clientWidth / 2 - 26;
    this.knob.style.transform = `translate(${-left * reach}px, ${-forward * reach}px)`;
    this.element.classList.add("held");
    if (!this.timer) {
      this.send(this.wish);
      this.timer = setInterval(() => this.send(this.wish), PERIOD);
    }
  }

  release() {
    this.keys.clear();
    if (!this.timer) return;
    clearInterval(this.timer);
    this.timer = 0;
    this.send({ do: "release" });
    this.knob.style.transform = "";
    this.element.classList.remove("held");
  }
}
