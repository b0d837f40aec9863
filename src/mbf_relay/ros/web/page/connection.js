// The WebSocket, and how it comes back: after a restart of the node or the master, and after the laptop slept.

import { decode } from "./batch.js";

const FIRST_WAIT = 500, LONGEST_WAIT = 5000, PING = 2000, SILENCE = 7000;  // ms

export class Connection {
  // `on` holds functions: state(name, words), say(message), batch(parts), which may return a promise.
  constructor(on) {
    this.on = on;
    this.wait = FIRST_WAIT;
    this.robot = "";
    this.token = "";
    this.layers = {};
    this.socket = null;
    this.retry = 0;
    this.shown = Promise.resolve();
    setInterval(() => this.watch(), PING);
    addEventListener("pagehide", () => this.leave());
    for (const event of ["online", "pageshow"]) addEventListener(event, () => this.hurry());
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.hurry(); });
  }

  open() {
    clearTimeout(this.retry);
    this.on.state("busy", "connecting");
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.reason = "";
    this.asked = performance.now();  // when the first question was sent that no answer has followed; 0 for none
    socket.onopen = () => socket.send(JSON.stringify({ do: "hello", token: this.token, robot: this.robot }));
    socket.onmessage = (event) => this.take(socket, event.data);
    socket.onclose = (event) => { if (socket === this.socket) this.lost(event); };
  }

  take(socket, data) {
    this.asked = 0;
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.say === "welcome") {
        this.wait = FIRST_WAIT;
        this.robot = message.guess ? "" : message.robot;
        this.show(this.layers);
        this.on.state("good", "live");
      } else if (message.say === "goodbye") this.reason = message.why;
      this.on.say(message);
      return;
    }
    this.shown = this.shown.then(() => this.showBatch(socket, data));  // one after the other, as they came
  }

  async showBatch(socket, data) {
    const { number, parts } = decode(data);
    try {
      await this.on.batch(parts);
    } catch (error) {
      console.error(error);
    }
    // Only now the next one may come.
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: "ack", number }));
  }

  send(wish) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(wish));
    return true;
  }

  show(layers) {
    this.layers = layers;
    this.send({ do: "show", layers });
  }

  lost() {
    this.socket = null;
    if (/token/.test(this.reason)) {
      this.on.state("bad", "no access");
      return;
    }
    this.on.state("bad", this.reason || "connection lost");
    this.retry = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(LONGEST_WAIT, this.wait * 1.6);
  }

  drop() {
    const old = this.socket;
    this.socket = null;
    old.onclose = old.onmessage = null;
    old.close();
  }

  // A browser may keep a page that was left for a while, to show it again at once; its socket would stay open.
  leave() {
    clearTimeout(this.retry);
    if (this.socket) this.drop();
  }

  // A connection that died without a word, as when a laptop sleeps, is only known by a question that stays unanswered;
  // silence alone is none: a hidden tab, whose timers a browser lets run once a minute, asks as seldom.
  watch() {
    if (!this.socket) return;
    const now = performance.now();
    if (this.asked && now - this.asked > SILENCE) {
      this.drop();
      this.lost();
    } else {
      if (!this.asked) this.asked = now;
      this.send({ do: "ping", time: Math.round(now) });
    }
  }

  hurry() {
    this.wait = FIRST_WAIT;
    if (!this.socket && !/token/.test(this.reason || "")) this.open();
    else this.watch();
  }
}
