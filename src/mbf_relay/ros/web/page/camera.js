// Where the map lies on the screen: metres to pixels, y up.

const LEAST = 0.02, MOST = 2000;  // pixels per metre: 1000 pixels show 50 km, or half a metre

export class Camera {
  constructor() {
    this.x = 0;
    this.y = 0;
    this.scale = 60;  // pixels per metre
    this.width = this.height = 1;
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  toMap(column, row) {
    return [this.x + (column - this.width / 2) / this.scale, this.y - (row - this.height / 2) / this.scale];
  }

  pan(columns, rows) {
    this.x -= columns / this.scale;
    this.y += rows / this.scale;
  }

  zoom(factor, column = this.width / 2, row = this.height / 2) {
    const [x, y] = this.toMap(column, row);
    this.scale = Math.min(MOST, Math.max(LEAST, this.scale * factor));
    const [newX, newY] = this.toMap(column, row);
    this.x += x - newX;
    this.y += y - newY;
  }

  sees([left, bottom, right, top]) {
    const [x0, y1] = this.toMap(0, 0), [x1, y0] = this.toMap(this.width, this.height);
    return left < x1 && right > x0 && bottom < y1 && top > y0;
  }

  fit([left, bottom, right, top], margin = 0.86) {
    this.x = (left + right) / 2;
    this.y = (bottom + top) / 2;
    this.scale = Math.min(400, Math.max(LEAST, margin * Math.min(this.width / (right - left || 1), this.height / (top - bottom || 1))));
  }
}
