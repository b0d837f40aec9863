// Everything told in words. Text that comes from topics goes in as text, never as markup.

import { keep, kept } from "./kept.js";

const OUTCOMES = { idle: "No goal", active: "On the way", reached: "Goal reached", cancelled: "Cancelled", failed: "Failed" };
const LEVELS = ["well", "warning", "error", "stale"];
const KEPT = 30;

export const LAYERS = [  // name, words, shown at first, how often (Hz); those without a rate are drawn from what is there
  ["map", "map", true, 2], ["global_costmap", "global costmap", true, 4], ["local_costmap", "local costmap", true, 4],
  ["scan", "scan", true, 10], ["particles", "particles", true, 2], ["global_plan", "global plan", true, 4],
  ["local_plan", "local plan", true, 5], ["trajectories", "trajectories by cost", false, 4], ["footprint", "footprint", true, 5],
  ["obstacles", "boxes", true, 2], ["trail", "path driven", true, 0], ["queue", "waypoints", true, 0],
  ["others", "other robots", true, 0], ["grid", "metre grid", true, 0],
];
const REMARKS = { trajectories: "The controller publishes them where its publish_traj_pc is on." };

export const $ = (id) => document.getElementById(id);

export function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== null) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

// Writes only what is new, so that a screen reader is not told the same again.
function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Makes anew only the items that tell something else: a button that is just being pressed stays, and so does selected text.
function fill(list, entries, make) {
  entries.forEach((entry, index) => {
    const told = JSON.stringify(entry), old = list.children[index];
    if (old && old.told === told) return;
    const item = make(entry, index);
    item.told = told;
    if (old) old.replaceWith(item);
    else list.append(item);
  });
  while (list.children.length > entries.length) list.lastChild.remove();
}

function time(seconds) {
  if (seconds === null) return "–";
  return seconds < 90 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}

export class Panel {
  constructor(show) {
    this.shown = new Set();
    this.entries = [];
    for (const [name, words, first] of LAYERS) {
      const label = element("label", null), box = element("input", null, { type: "checkbox", id: `layer-${name}` });
      const choice = kept(`layer-${name}`);
      box.checked = choice === null ? first : choice === "on";
      if (box.checked) this.shown.add(name);
      box.addEventListener("change", () => {
        this.shown[box.checked ? "add" : "delete"](name);
        keep(`layer-${name}`, box.checked ? "on" : "off");
        show();
      });
      label.append(box, words);
      if (REMARKS[name]) label.title = REMARKS[name];
      const item = element("li", null);
      item.append(label);
      $("layers").append(item);
    }
  }

  rates() {
    const rates = { robot: 30, state: 4, diagnostics: 1, log: 1 };
    for (const [name, , , rate] of LAYERS) if (rate && this.shown.has(name)) rates[name] = rate;
    return rates;
  }

  state(state) {
    const { goal } = state, outcome = $("outcome");
    outcome.dataset.state = goal.state;
    let words = OUTCOMES[goal.state] || goal.state;
    if (goal.state === "failed" && goal.outcome) words = goal.outcome;
    if (goal.state === "active" && goal.recovering) words = `Recovering: ${goal.recovering}`;
    put(outcome, words);
    for (const item of $("parts").children) {
      item.classList.toggle("on", Boolean(goal[item.dataset.part]));
    }
    put($("left"), goal.left === null ? "–" : `${goal.left.toFixed(1)} m`);
    put($("time-left"), time(goal.time_left));
    put($("fit-share"), state.fit === null ? "–" : /^\d+$/.test(state.fit) ? `${state.fit} %` : state.fit);
    put($("company"), state.browsers > 1 ? `${state.browsers} browsers${state.driver ? ", one drives" : ""}` : "");
    $("record").setAttribute("aria-pressed", state.recording);
    $("record").classList.toggle("recording", state.recording);
    put($("record"), state.recording ? "Stop recording" : "Record");
    for (const node of document.querySelectorAll("[data-simulator]")) node.hidden = !state.simulator;
    $("error-key").hidden = state.error === null;
    if (state.error !== null) put($("chart-error"), `${(100 * state.error).toFixed(1)} cm`);
    this.robots(state.robots);
  }

  // The robot that is shown is on the list though it is away: else there were no way to another.
  robots(found) {
    const chooser = $("robot"), { chosen } = chooser.dataset, names = found.includes(chosen) ? found : [chosen, ...found];
    const known = names.join(" ");
    if (chooser.dataset.known === known) return;
    chooser.dataset.known = known;
    chooser.replaceChildren(...names.map((name) => element("option", name === "/" ? "robot" : name.replace(/^\/|\/$/g, ""), { value: name })));
    chooser.value = chosen;
    $("robot-field").hidden = names.length < 2;
  }

  figures(robot) {
    const speed = robot.speed ? robot.speed[0] : 0;
    put($("speed"), `${speed.toFixed(2)} m/s`);
    put($("chart-speed"), `${speed.toFixed(2)} m/s`);
  }

  diagnostics(entries) {
    const worst = entries.reduce((level, entry) => Math.max(level, entry.level), 0), health = $("health");
    health.dataset.state = ["good", "busy", "bad", "bad"][worst] || "bad";
    const bad = entries.filter((entry) => entry.level > 0).length;
    put(health, entries.length ? (bad ? `${bad} of ${entries.length} ${bad === 1 ? "complains" : "complain"}` : "all well") : "–");
    fill($("diagnostics"), entries, (entry) => {
      const item = element("li", null, { "data-level": entry.level });
      item.append(element("b", entry.name), " ", element("span", LEVELS[entry.level] || "?", { class: "hidden-text" }), " ", element("small", entry.text));
      return item;
    });
  }

  // A connection that has come back is told the last ones again.
  log(entries) {
    const known = new Set(this.entries.map((entry) => JSON.stringify(entry)));
    const fresh = entries.filter((entry) => !known.has(JSON.stringify(entry)));
    this.entries = [...fresh.reverse(), ...this.entries].slice(0, KEPT);
    put($("log-count"), String(this.entries.length));
    fill($("log"), this.entries, (entry) => {
      const item = element("li", null, { "data-level": entry.level });
      item.append(element("b", `${entry.time} ${entry.node}`), " ", element("small", entry.text));
      return item;
    });
  }

  waypoints(list, tour, remove) {
    const told = list.map((pose, index) => ({ pose, touring: Boolean(tour), next: Boolean(tour) && tour.index === index }));
    fill($("waypoints"), told, ({ pose: [x, y, heading], touring, next }, index) => {
      const item = element("li", null), words = `${x.toFixed(2)}, ${y.toFixed(2)}, ${Math.round(heading * 180 / Math.PI)}°`;
      if (next) item.classList.add("next");
      item.append(element("span", words));
      if (!touring) {
        const button = element("button", "×", { class: "quiet", "aria-label": `Remove waypoint ${index + 1}` });
        button.addEventListener("click", () => remove(index));
        item.append(button);
      }
      return item;
    });
    $("no-waypoints").hidden = list.length > 0;
    put($("waypoint-count"), list.length ? String(list.length) : "");
    $("tour").disabled = !list.length || Boolean(tour);
    $("forget").disabled = !list.length || Boolean(tour);
    put($("tour"), tour ? (tour.pausing ? "pausing" : `driving to ${tour.index + 1} of ${list.length}`) : "Drive the list");
  }

  // What is told again, as of a stick that is held, stays for longer.
  toast(words, refused = false) {
    const shown = $("toasts"), old = [...shown.children].find((note) => note.textContent === words), note = old || element("p", words);
    if (refused) note.className = "refused";
    if (!old) shown.append(note);
    while (shown.children.length > 3) shown.firstChild.remove();
    clearTimeout(note.timer);
    note.timer = setTimeout(() => note.remove(), refused ? 7000 : 4500);
  }

  banner(words) {
    $("banner").hidden = !words;
    put($("banner"), words);
  }
}
