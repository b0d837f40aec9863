// Wires the page together.

import { Camera } from "./camera.js";
import { Chart } from "./chart.js";
import { palette } from "./colours.js";
import { Connection } from "./connection.js";
import { keep, kept } from "./kept.js";
import { Painter } from "./painter.js";
import { $, Panel } from "./panel.js";
import { Scene } from "./scene.js";
import { Stick } from "./stick.js";
import { Tools } from "./tools.js";

const HINTS = {
  goal: "Press where the robot shall go, drag where it shall look.",
  waypoint: "Press and drag for each place; then drive the list.",
  pose: "Press where the robot stands, drag where it looks.",
  obstacle: "Press where a box shall stand.",
};
const SKETCH = { goal: "goal", waypoint: "goal", pose: "particles", obstacle: "warn" };
const KEYS = { g: "goal", w: "waypoint", p: "pose", o: "obstacle", Escape: "look" };
const WAIT_FOR_MAP = 4000, LOOK_PERIOD = 250;  // ms

const dark = matchMedia("(prefers-color-scheme: dark)");
function applyTheme() {
  document.documentElement.dataset.theme = kept("theme") || (dark.matches ? "dark" : "light");
}
applyTheme();

const camera = new Camera();
const painter = new Painter($("canvas"), camera);
const scene = new Scene(palette());
const sketch = { arrow: null, waypoints: [], colour: "goal", radius: 0, square: 0 };
const chart = new Chart($("chart"));
const panel = new Panel(() => { connection.show(panel.rates()); redraw(); });
let fitted = false, following = false, state = null, dirty = true, drives = false, live = false, welcomed = 0, mapPlace = "";

function redraw() {
  dirty = true;
}

function follow(on) {
  following = on;
  $("follow").setAttribute("aria-pressed", on);
  redraw();
}

const tools = new Tools($("canvas"), camera, sketch, () => scene.robot.pose, {
  changed: redraw, placed, moved() {
    fitted = fitted || Boolean(scene.grids.map.shape);
    follow(false);
  },
});

function choose(tool) {
  if (tool !== "look" && !drives) return;
  tools.take(tool);
  for (const button of $("tools").children) button.setAttribute("aria-pressed", button.dataset.tool === tool);
  sketch.colour = SKETCH[tool] || "goal";
  sketch.radius = tool === "pose" ? Number($("spread").value) : 0;
  sketch.square = tool === "obstacle" ? Number($("size").value) : 0;
  $("hint").hidden = !(tool in HINTS);
  $("hint-text").textContent = HINTS[tool] || "";
  $("spread-field").hidden = tool !== "pose";
  $("size-field").hidden = tool !== "obstacle";
}

function placed(tool, [x, y, theta]) {
  if (tool === "goal") wish({ do: "goal", x, y, theta });
  if (tool === "pose") wish({ do: "pose", x, y, theta, spread: Number($("spread").value), turn_spread: 0.26 });
  if (tool === "obstacle") wish({ do: "obstacle", x, y, size: Number($("size").value) });
  if (tool === "waypoint") {
    if (scene.tour) panel.toast("Not added: a list is being driven. Cancel it first.", true);
    else if (sketch.waypoints.length >= 50) panel.toast("Not added: a list has 50 waypoints at most.", true);
    else sketch.waypoints.push([x, y, theta]);
    showWaypoints();
  } else choose("look");
}

function showWaypoints() {
  panel.waypoints(scene.tour ? scene.tour.waypoints : sketch.waypoints, scene.tour, (index) => {
    sketch.waypoints.splice(index, 1);
    showWaypoints();
  });
  redraw();
}

function wish(message) {
  if (!connection.send(message)) panel.toast("Not connected: nothing was sent.", true);
}

const connection = new Connection({
  state(name, words) {
    const pill = $("connection");
    live = name === "good";
    pill.dataset.state = name;
    pill.textContent = words;
    document.body.classList.toggle("away", name !== "good");
    if (name === "bad" && words !== "no access") {
      panel.banner(`${words[0].toUpperCase()}${words.slice(1)}. What you see is old; trying again.`);
    } else if (name === "good") panel.banner("");
    if (name !== "good") stick.release();
  },
  say(message) {
    if (message.say === "welcome") welcome(message);
    if (message.say === "pong") $("round-trip").textContent = `${Math.max(0, Math.round(performance.now() - message.time))} ms`;
    if (message.say === "told") panel.toast(message.text);
    if (message.say === "refused") panel.toast(message.why, true);
    if (message.say === "goodbye" && /token/.test(message.why)) askForToken(connection.token ? message.why : "");
  },
  async batch(parts) {
    for (const part of parts) {
      await scene.take(part);
      take(part.header);
    }
    redraw();
  },
});

const stick = new Stick($("stick"), $("knob"), (message) => connection.send(message));

function welcome({ drive, robot, guess }) {
  drives = drive;
  welcomed = performance.now();
  document.body.classList.toggle("look-only", !drive);
  const chooser = $("robot");
  if (chooser.dataset.chosen !== robot) {
    scene.clear(palette());
    chart.clear();
    fitted = false;
  }
  chooser.dataset.chosen = robot;
  chooser.value = robot;
  document.title = robot === "/" ? "Robot" : robot.replace(/^\/|\/$/g, "");
  if ($("token-dialog").open) $("token-dialog").close();
  if (connection.token) keep("token", connection.token, "sessionStorage");
  if (!guess) keep("robot", robot, "sessionStorage");
}

function take(header) {
  if (header.layer === "robot") {
    panel.figures(header);
  } else if (header.layer === "state") {
    state = header;
    panel.state(state);
    showWaypoints();
  } else if (header.layer === "diagnostics") panel.diagnostics(header.entries);
  else if (header.layer === "log") panel.log(header.entries);
  else if (header.layer === "map") takeMap(header);
}

// One that grows under a person's eyes stays where it is; one that lies elsewhere would be out of sight.
function takeMap({ tiles, ...shape }) {
  const place = JSON.stringify(shape), isOther = place !== mapPlace;
  mapPlace = place;
  if (!following && (!fitted || (isOther && !camera.sees(scene.grids.map.bounds())))) fit();
}

// By the clock: who stands still, or is not there, sends nothing new.
setInterval(() => {
  if (!live || !state) return;
  chart.add(scene.robot.speed[0], state.error);
  chart.draw(scene.colours);
  tellWhatIsMissing();
}, LOOK_PERIOD);

function tellWhatIsMissing() {
  if (performance.now() - welcomed < WAIT_FOR_MAP) return;
  if (!state.master) panel.banner("The ROS master does not answer. Waiting for it.");
  else if (!state.has_map && !scene.robot.pose) panel.banner("Connected, but there is no map, and nothing tells where a robot is.");
  else if (!scene.robot.pose) panel.banner("Nothing tells where the robot is on the map. Is its localization running?");
  else panel.banner("");
}

function fit() {
  const { map } = scene.grids;
  if (map.shape) {
    camera.fit(map.bounds());
    if (!fitted) performance.mark("map");
    fitted = map.isWhole;
  } else if (scene.robot.pose) [camera.x, camera.y] = scene.robot.pose;
  follow(false);
}

function scaleBar() {
  const length = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((size) => size * camera.scale >= 70) || 5000;
  $("scale-bar").style.width = `${Math.round(length * camera.scale)}px`;
  $("scale-text").textContent = length < 1 ? `${Math.round(length * 100)} cm` : `${length} m`;
}

function frame() {
  if (dirty) {
    dirty = false;
    if (following && scene.robot.pose) [camera.x, camera.y] = scene.robot.pose;
    painter.draw(scene, panel.shown, sketch);
    scaleBar();
    page.frames += 1;
  }
  requestAnimationFrame(frame);
}

function askForToken(words) {
  $("token-wrong").textContent = words;
  if (!$("token-dialog").open) $("token-dialog").showModal();
}

function press(id, action) {
  $(id).addEventListener("click", action);
}

for (const button of $("tools").children) button.addEventListener("click", () => choose(button.dataset.tool));
addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey || $("token-dialog").open) return;
  if (event.key in KEYS && !(event.key === "o" && !(state && state.simulator))) choose(KEYS[event.key]);
});
press("cancel", () => wish({ do: "cancel" }));
press("clear", () => wish({ do: "clear" }));
press("record", () => wish({ do: "record", on: !(state && state.recording) }));
press("reset", () => { scene.trail = []; wish({ do: "reset" }); });
press("remove-obstacles", () => wish({ do: "remove_obstacles" }));
press("tour", () => wish({ do: "tour", waypoints: sketch.waypoints, loop: $("loop").checked, pause: Number($("pause").value) || 0 }));
press("forget", () => { sketch.waypoints.length = 0; showWaypoints(); });
press("zoom-in", () => { camera.zoom(1.3); redraw(); });
press("zoom-out", () => { camera.zoom(1 / 1.3); redraw(); });
press("fit", fit);
press("follow", () => follow(!following));
press("handle", () => {
  const open = $("panel").classList.toggle("open");
  $("handle").setAttribute("aria-expanded", open);
  stick.release();  // it is out of sight on a small screen
});
press("theme", () => {
  keep("theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  retheme();
});
function retheme() {
  applyTheme();
  scene.recolour(palette());
  chart.draw(scene.colours);
  redraw();
}
dark.addEventListener("change", retheme);
for (const [id, key, unit] of [["spread", "radius", "m"], ["size", "square", "m"]]) {
  $(id).addEventListener("input", () => {
    sketch[key] = Number($(id).value);
    $(`${id}-value`).textContent = `${$(id).value} ${unit}`;
  });
}
$("goto").addEventListener("submit", (event) => {
  event.preventDefault();
  const form = new FormData(event.target);
  wish({ do: "goal", x: Number(form.get("x")), y: Number(form.get("y")), theta: (Number(form.get("heading")) % 360) * Math.PI / 180 });
});
$("robot").addEventListener("change", (event) => wish({ do: "robot", name: event.target.value }));
$("token-form").addEventListener("submit", (event) => {
  event.preventDefault();
  connection.token = $("token").value.trim();
  connection.open();
});

// A page without access has nothing to show but this question.
$("token-dialog").addEventListener("close", () => { if (!live) askForToken($("token-wrong").textContent); });

new ResizeObserver(() => { painter.resize(); redraw(); }).observe($("canvas"));
painter.resize();

// The token comes after the # of the address, which no server is told, and does not stay there.
const given = new URLSearchParams(location.hash.slice(1)).get("token");
connection.token = given || kept("token", "sessionStorage") || "";
if (given) history.replaceState(null, "", location.pathname);
connection.robot = kept("robot", "sessionStorage") || "";
connection.layers = panel.rates();

// For tests and figures: what the page knows and has drawn.
const page = window.page = { frames: 0, scene, camera, connection, get state() { return state; }, redraw };
connection.open();
requestAnimationFrame(frame);
