// Colours, taken from the style sheet, so that dark and light are decided in one place.

export function palette() {
  const style = getComputedStyle(document.documentElement);
  const get = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = ["ground", "surface", "ink", "faint", "line", "accent", "grid", "robot", "scan", "particles", "plan", "local", "goal", "trail", "truth", "warn", "bad",
    "map-free", "map-wall", "map-unknown"];
  return Object.fromEntries(names.map((name) => [name, get(name)]));
}

const rgba = (r, g, b, a) => ((a << 24) | (b << 16) | (g << 8) | r) >>> 0;  // as bytes lie in an ImageData

function rgb(hex) {
  const value = parseInt(hex.slice(1, 7), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}

export function mapPaint(colours) {
  const free = rgb(colours["map-free"]), wall = rgb(colours["map-wall"]), paint = new Uint32Array(256);
  for (let value = 0; value <= 100; value++) {
    const share = value / 100;
    paint[value] = rgba(...free.map((channel, i) => Math.round(channel + share * (wall[i] - channel))), 255);
  }
  paint[255] = rgba(...rgb(colours["map-unknown"]), 255);
  return paint;
}

// Costs: nothing where it is free, the lethal and the inscribed clear to see, a haze between.
export function costPaint(lethal, inscribed, haze) {
  const paint = new Uint32Array(256);
  for (let value = 1; value < 99; value++) paint[value] = rgba(...haze, Math.round(4 + 1.2 * value));
  paint[99] = rgba(...inscribed, 170);
  paint[100] = rgba(...lethal, 220);
  return paint;
}

export const PAINTS = {
  global_costmap: () => costPaint([150, 40, 190], [70, 130, 220], [70, 130, 220]),
  local_costmap: () => costPaint([220, 40, 60], [240, 130, 40], [240, 160, 40]),
};

// From cheap to dear, in steps, so that equal colours can be drawn together.
export const COSTS = Array.from({ length: 10 }, (_, i) => `hsl(${140 - 14 * i} 80% 48%)`);
