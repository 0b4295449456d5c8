// Arrays in one piece, as naris.serve.parcel packs them.

const KINDS = { int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint32: Uint32Array, float32: Float32Array };

/** `{about, arrays}` of a parcel; each array is a typed array with its `shape` beside it. */
export function unpack(buffer) {
  const bytes = new Uint8Array(buffer);
  if (bytes.length < 8 || String.fromCharCode(...bytes.subarray(0, 4)) !== "NARP") throw new Error("not a parcel");
  const length = new DataView(buffer).getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(8, 8 + length)));
  const arrays = {};
  for (const [name, { dtype, shape, at }] of Object.entries(header.arrays)) {
    const count = shape.reduce((a, b) => a * b, 1);
    arrays[name] = new KINDS[dtype](buffer, 8 + length + at, count);
    arrays[name].shape = shape;
  }
  return { about: header.about, arrays };
}
