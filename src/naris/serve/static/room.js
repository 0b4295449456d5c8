// The room around the scope: how far the wall is, which way it lies, and in which region a place is.

/** Distances and regions on the grids of naris.serve.stage.room_parcel. */
export class Room {
  constructor({ about, arrays }) {
    this.origin = about.origin;
    this.spacing = about.spacing;
    this.step = about.step;
    this.deepest = about.deepest;
    this.stride = about.stride;
    this.nowhere = about.nowhere;
    this.values = arrays.distance;
    this.labels = arrays.region;
  }

  /** Distance to the nearest wall (mm), positive in the air; tissue has no more than `deepest`. */
  distance(p) {
    const [nx, ny, nz] = this.values.shape;
    const x = (p[0] - this.origin[0]) / this.spacing;
    const y = (p[1] - this.origin[1]) / this.spacing;
    const z = (p[2] - this.origin[2]) / this.spacing;
    const i = Math.floor(x), j = Math.floor(y), k = Math.floor(z);
    if (i < 0 || j < 0 || k < 0 || i > nx - 2 || j > ny - 2 || k > nz - 2) return -this.deepest;
    const a = x - i, b = y - j, c = z - k, v = this.values, at = (i * ny + j) * nz + k, up = ny * nz;
    const low = mix(mix(v[at], v[at + 1], c), mix(v[at + nz], v[at + nz + 1], c), b);
    const high = mix(mix(v[at + up], v[at + up + 1], c), mix(v[at + up + nz], v[at + up + nz + 1], c), b);
    return mix(low, high, a) * this.step;
  }

  /** The unit direction away from the nearest wall. */
  away(p) {
    const h = this.spacing / 2;
    const g = [0, 1, 2].map((axis) => {
      const q = [...p], r = [...p];
      q[axis] += h;
      r[axis] -= h;
      return this.distance(q) - this.distance(r);
    });
    const length = Math.hypot(...g);
    return length > 1e-9 ? g.map((one) => one / length) : [0, 0, 0];
  }

  /** The number of the region of a place, or -1. */
  region(p) {
    const [nx, ny, nz] = this.labels.shape;
    const [i, j, k] = p.map((one, axis) => Math.round((one - this.origin[axis]) / (this.spacing * this.stride)));
    if (i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz) return -1;
    const label = this.labels[(i * ny + j) * nz + k];
    return label === this.nowhere ? -1 : label;
  }
}

function mix(a, b, t) {
  return a + t * (b - a);
}
