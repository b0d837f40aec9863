// Reads what mbf_relay/view/batch.py writes: a number, then parts of a JSON header and bytes.

const text = new TextDecoder();

export function decode(buffer) {
  const view = new DataView(buffer);
  const parts = [];
  let offset = 4;
  while (offset < buffer.byteLength) {
    const headerLength = view.getUint32(offset, true);
    const payloadLength = view.getUint32(offset + 4, true);
    const begin = offset + 8;
    const header = JSON.parse(text.decode(new Uint8Array(buffer, begin, headerLength)));
    offset = begin + headerLength + payloadLength;
    parts.push({ header, payload: buffer.slice(begin + headerLength, offset) });
  }
  return { number: view.getUint32(0, true), parts };
}

// Points as x, y (m) and, where there is one, a third column (heading in rad, or cost from 0 to 1), in one flat array.
export function points({ header, payload }) {
  const columns = header.columns || 2;
  if (!header.count) return { columns, values: new Float64Array(0) };
  const raw = new Int16Array(payload);
  const values = new Float64Array(raw.length);  // maps may lie in UTM coordinates
  for (let i = 0; i < raw.length; i += columns) {
    values[i] = raw[i] * header.unit + header.origin[0];
    values[i + 1] = raw[i + 1] * header.unit + header.origin[1];
    if (columns > 2) values[i + 2] = raw[i + 2] * 1e-4;
  }
  return { columns, values };
}

export async function inflate(payload) {
  const stream = new Blob([payload]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
