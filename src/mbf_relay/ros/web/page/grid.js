// A grid layer: cells as they come in tiles, painted into canvases no larger than any browser takes.

const CHUNK = 1024;  // cells

export class Grid {
  constructor(paint) {
    this.paint = paint;  // 256 colours, one for each value: 0 to 100, and 255 where nothing is known
    this.shape = null;
  }

  take(header, cells) {
    const same = this.shape && ["width", "height", "resolution", "frame"].every((key) => this.shape[key] === header[key]);
    if (!same) {
      this.cells = new Uint8Array(header.width * header.height).fill(255);
      this.chunks = new Map();
      this.come = new Set();
    }
    this.shape = header;
    const across = Math.ceil(header.width / header.tile);
    let offset = 0;
    for (const index of header.tiles) {
      this.come.add(index);
      const column = (index % across) * header.tile, row = Math.floor(index / across) * header.tile;
      const width = Math.min(header.tile, header.width - column), height = Math.min(header.tile, header.height - row);
      for (let line = 0; line < height; line++) {
        this.cells.set(cells.subarray(offset, offset + width), (row + line) * header.width + column);
        offset += width;
      }
      this.draw(column, row, width, height);
    }
  }

  // Whether every tile has come; of a large grid that takes seconds.
  get isWhole() {
    const { width, height, tile } = this.shape;
    return this.come.size === Math.ceil(width / tile) * Math.ceil(height / tile);
  }

  recolour(paint) {
    this.paint = paint;
    if (!this.shape) return;
    const { width, height, tile } = this.shape;
    for (let row = 0; row < height; row += tile) {
      for (let column = 0; column < width; column += tile) {
        this.draw(column, row, Math.min(tile, width - column), Math.min(tile, height - row));
      }
    }
  }

  draw(column, row, width, height) {
    const image = new ImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    for (let line = 0, at = 0; line < height; line++) {
      let from = (row + line) * this.shape.width + column;
      for (let i = 0; i < width; i++) pixels[at++] = this.paint[this.cells[from++]];
    }
    const left = Math.floor(column / CHUNK), bottom = Math.floor(row / CHUNK), key = `${left} ${bottom}`;
    let chunk = this.chunks.get(key);
    if (!chunk) {
      const canvas = document.createElement("canvas");
      canvas.width = Math.min(CHUNK, this.shape.width - left * CHUNK);
      canvas.height = Math.min(CHUNK, this.shape.height - bottom * CHUNK);
      chunk = { canvas, context: canvas.getContext("2d"), left: left * CHUNK, bottom: bottom * CHUNK };
      this.chunks.set(key, chunk);
    }
    chunk.context.putImageData(image, column - chunk.left, row - chunk.bottom);
  }

  // The context is in metres from the grid's corner, y up, which turns the rows the right way.
  render(context) {
    const { resolution } = this.shape;
    for (const { canvas, left, bottom } of this.chunks.values()) {
      context.drawImage(canvas, left * resolution, bottom * resolution, canvas.width * resolution, canvas.height * resolution);
    }
  }

  // The box round what is known, for fitting the view: [left, bottom, right, top] in the grid's frame.
  bounds() {
    const { width, height, resolution, origin } = this.shape;
    let left = width, right = 0, bottom = height, top = 0;
    for (let row = 0, at = 0; row < height; row++) {
      for (let column = 0; column < width; column++, at++) {
        if (this.cells[at] !== 255) {
          if (column < left) left = column;
          if (column > right) right = column;
          if (row < bottom) bottom = row;
          if (row > top) top = row;
        }
      }
    }
    if (left > right) [left, right, bottom, top] = [0, width, 0, height];
    const [x0, y0, turn] = origin, cosine = resolution * Math.cos(turn), sine = resolution * Math.sin(turn);
    const corners = [[left, bottom], [right + 1, bottom], [right + 1, top + 1], [left, top + 1]];
    const x = corners.map(([column, row]) => x0 + column * cosine - row * sine);
    const y = corners.map(([column, row]) => y0 + column * sine + row * cosine);
    return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
  }
}
