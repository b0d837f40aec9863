// Speed (m/s), and where the truth is known the position's error (m), over the last minute.

const SPAN = 60000, GAP = 2000;  // ms

export class Chart {
  constructor(canvas) {
    this.canvas = canvas;
    this.rows = [];
  }

  clear() {
    this.rows = [];
  }

  add(speed, error) {
    const now = performance.now();
    this.rows.push([now, speed, error]);
    while (this.rows[0][0] < now - SPAN) this.rows.shift();
  }

  draw(colours) {
    const { canvas } = this, ratio = Math.min(2, devicePixelRatio || 1), width = canvas.clientWidth, height = 84;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = height * ratio;
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.strokeStyle = colours.line;
    context.lineWidth = 1;
    for (const y of [0.5, height / 2, height - 0.5]) {
      context.beginPath();
      context.moveTo(0, y);
      context.lineTo(width, y);
      context.stroke();
    }
    this.line(context, 1, 0.1, colours.accent, width, height, "m/s", 0, colours);
    this.line(context, 2, 0.1, colours.truth, width, height, "m", 1, colours);
  }

  // Each line has a scale of its own, from 0 to a round number, told at its end of the chart.
  line(context, column, least, colour, width, height, unit, side, colours) {
    const rows = this.rows.filter((row) => row[column] !== null && Number.isFinite(row[column]));
    if (!rows.length) return;
    const highest = Math.max(...rows.map((row) => Math.abs(row[column])));
    const top = [0.1, 0.2, 0.3, 0.5, 1, 2, 5, 10, 50, 100].find((value) => value >= Math.max(least, highest)) || highest;
    const now = performance.now();
    context.beginPath();
    let last = -Infinity;
    for (const row of rows) {
      context[row[0] - last > GAP ? "moveTo" : "lineTo"](width * (1 - (now - row[0]) / SPAN), height - 2 - (height - 6) * Math.abs(row[column]) / top);
      last = row[0];
    }
    context.strokeStyle = colour;
    context.lineWidth = 1.8;
    context.lineJoin = "round";
    context.stroke();
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colours.faint;
    context.textAlign = side ? "right" : "left";
    context.fillText(`${top} ${unit}`, side ? width - 2 : 2, 12);
  }
}
