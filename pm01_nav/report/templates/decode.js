// The other side of replays.py: base64, deflate, header, arrays of changes in time.

async function unpackReplay(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  let at = 4 + length;
  const arrays = {};
  for (const [name, spec] of Object.entries(header.arrays)) {
    const count = spec.shape.reduce((product, side) => product * side, 1);
    arrays[name] = unpackArray(bytes.subarray(at, at + count * spec.bytes), spec, count);
    at += count * spec.bytes;
  }
  const grid = unpackBits(bytes.subarray(at), header.grid.shape);
  return { ...header, ...arrays, grid: { ...header.grid, cells: grid } };
}

// Numbers that were none (NaN or infinite) come back as NaN.
function unpackArray(bytes, { shape, bytes: size, low, step }, count) {
  const mask = size === 1 ? 0xff : 0xffff;
  const row = shape.slice(1).reduce((product, side) => product * side, 1);
  const codes = new Uint16Array(count);
  const values = new Float32Array(count);
  for (let k = 0; k < count; k++) {
    const zigzag = size === 1 ? bytes[k] : bytes[k] | (bytes[count + k] << 8);
    const change = (zigzag >>> 1) ^ -(zigzag & 1);
    codes[k] = ((k < row ? 0 : codes[k - row]) + change) & mask;
    values[k] = codes[k] === mask ? NaN : low + step * codes[k];
  }
  return values;
}

function unpackBits(bytes, [height, width]) {
  const cells = new Uint8Array(height * width);
  for (let k = 0; k < cells.length; k++) cells[k] = (bytes[k >> 3] >> (7 - (k & 7))) & 1;
  return cells;
}
