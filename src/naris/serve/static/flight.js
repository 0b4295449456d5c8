// The scope as a thing that moves: its shaft, its optics, walls that it slides along, and the way back.
//
// Poses are anatomy_T_camera, 4×4, row by row; a camera looks along +z, x is right and y is down in its picture.

const TIP_MM = 0.35; // the least room around the lens
const STRIDE_MM = 0.1; // no step is longer, so that no wall is jumped over
const PUSHES = 6;
const SPEED = { least: 1.5, most: 25, perClearance: 3 };
const TURN_DEG_S = 45;
const MOST_UNDO = 200;
const LEAST_UPRIGHT = 0.05;

export class Flight {
  constructor(room, pose) {
    this.room = room;
    this.throughWalls = false;
    this.opticsDeg = 0;
    this.lightPostDeg = 0;
    this.inserted = 0;
    this.past = [];
    this.position = [0, 0, 0];
    this.shaft = identity();
    this.setPose(pose);
  }

  /** anatomy_T_camera: the shaft turned by the angle of the optics, towards the side that the light post tells. */
  get pose() {
    return toMatrix(times(this.shaft, this.#optics()), this.position);
  }

  setPose(matrix) {
    this.position = matrix.slice(0, 3).map((row) => row[3]);
    const camera = matrix.slice(0, 3).map((row) => row.slice(0, 3));
    this.shaft = straightened(times(camera, transposed(this.#optics())));
  }

  /** Other optics on the same shaft: what it sees changes, where it is does not. */
  setOptics(angleDeg, lightPostDeg) {
    this.opticsDeg = angleDeg;
    this.lightPostDeg = lightPostDeg;
  }

  #optics() {
    const post = about(2, radians(this.lightPostDeg));
    return times(times(post, about(0, radians(this.opticsDeg))), transposed(post));
  }

  /** What the scope may do in a second, by the room around it (mm). */
  get speed() {
    const room = Math.max(this.room.distance(this.position), 0);
    return Math.min(Math.max(room * SPEED.perClearance, SPEED.least), SPEED.most);
  }

  /** One step of time (s): `wish` has move (right, down, along the shaft) and turn (pitch, yaw, roll), −1 to 1. */
  advance(wish, seconds, haste = 1) {
    if (wish.turn.some(Boolean)) {
      const angle = radians(TURN_DEG_S) * seconds * haste;
      this.turn(wish.turn.map((one) => one * angle));
    }
    if (wish.move.some(Boolean)) {
      const way = this.speed * seconds * haste;
      this.move(wish.move.map((one) => one * way));
    }
  }

  /** Turns the picture: pitch (up is positive), yaw (right is positive), roll (clockwise is positive), radians. */
  turn([pitch, yaw, roll]) {
    const optics = this.#optics();
    const camera = times(this.shaft, optics);
    const turned = times(times(times(camera, about(1, yaw)), about(0, pitch)), about(2, roll));
    this.shaft = straightened(times(turned, transposed(optics)));
  }

  /** Moves the tip in the axes of the shaft (mm: right, down, inwards); it slides along walls. Gives how far it went. */
  move(by) {
    const way = apply(this.shaft, by);
    const length = Math.hypot(...way);
    const steps = Math.max(Math.ceil(length / STRIDE_MM), 1);
    const before = this.position;
    for (let i = 0; i < steps; i++) {
      const there = this.position.map((one, axis) => one + way[axis] / steps);
      const allowed = this.throughWalls ? there : this.#beside(there);
      if (allowed === null) break;
      this.position = allowed;
    }
    const gone = this.position.map((one, axis) => one - before[axis]);
    this.inserted += dot(gone, column(this.shaft, 2));
    return Math.hypot(...gone);
  }

  /** The place itself where there is room, else one beside it that has; null where there is none so near. */
  #beside(there) {
    const now = this.room.distance(this.position);
    const wanted = Math.min(TIP_MM, Math.max(now, 0)); // where it is narrower already, no narrower than now
    if (now < 0) return this.room.distance(there) >= now ? there : null; // out of the wall, or as deep
    let place = there;
    for (let k = 0; k < PUSHES; k++) {
      const room = this.room.distance(place);
      if (room >= wanted - 1e-6) return place;
      const away = this.room.away(place);
      place = place.map((one, axis) => one + away[axis] * (wanted - room + 1e-3));
    }
    return this.room.distance(place) >= wanted - 1e-6 ? place : null;
  }

  /** Goes somewhere at once; `undo` comes back. */
  jump(matrix) {
    this.remember();
    this.setPose(matrix);
    this.inserted = 0;
  }

  remember() {
    this.past.push(this.pose);
    if (this.past.length > MOST_UNDO) this.past.shift();
  }

  undo() {
    const back = this.past.pop(); // whoever moves it along a way must stop that first
    if (back) this.setPose(back);
    return Boolean(back);
  }
}

/** Between two poses: straight, and the shortest turn. */
export function between(a, b, t) {
  const place = [0, 1, 2].map((axis) => a[axis][3] + t * (b[axis][3] - a[axis][3]));
  const ra = a.slice(0, 3).map((row) => row.slice(0, 3));
  const rb = b.slice(0, 3).map((row) => row.slice(0, 3));
  const [axis, angle] = axisOf(times(transposed(ra), rb));
  return toMatrix(straightened(times(ra, aroundAxis(axis, t * angle))), place);
}

/** Where a place appears in the picture of a camera, in [−1, 1] right and down of half its height; null behind it. */
export function project(pose, point, fovDeg) {
  const d = [0, 1, 2].map((axis) => point[axis] - pose[axis][3]);
  const [x, y, z] = [0, 1, 2].map((c) => pose[0][c] * d[0] + pose[1][c] * d[1] + pose[2][c] * d[2]);
  if (z <= 0) return null;
  const scale = 1 / Math.tan(radians(fovDeg) / 2);
  return [(scale * x) / z, (scale * y) / z];
}

/** By how much a picture is turned clockwise from upright, up being +z (degrees); null where it looks up or down. */
export function rollOf(pose) {
  const right = pose[2][0], down = pose[2][1];
  return Math.hypot(right, down) < LEAST_UPRIGHT ? null : (Math.atan2(-right, -down) * 180) / Math.PI;
}

function axisOf(m) {
  const cosine = Math.min(Math.max((m[0][0] + m[1][1] + m[2][2] - 1) / 2, -1), 1);
  const angle = Math.acos(cosine);
  const axis = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
  const length = Math.hypot(...axis);
  if (length > 1e-9) return [axis.map((one) => one / length), angle];
  if (angle < 1) return [[0, 0, 1], 0];
  const k = [0, 1, 2].reduce((best, i) => (m[i][i] > m[best][best] ? i : best), 0); // half a turn
  const half = [0, 1, 2].map((i) => (m[i][k] + (i === k ? 1 : 0)) / 2);
  const norm = Math.hypot(...half);
  return [half.map((one) => one / norm), angle];
}

function aroundAxis([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), t = 1 - c;
  return [
    [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
    [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
    [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
  ];
}

function about(axis, angle) {
  return aroundAxis([0, 1, 2].map((one) => (one === axis ? 1 : 0)), angle);
}

function identity() {
  return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
}

export function radians(degrees) {
  return (degrees * Math.PI) / 180;
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function column(m, k) {
  return [m[0][k], m[1][k], m[2][k]];
}

function apply(m, v) {
  return m.map((row) => dot(row, v));
}

function transposed(m) {
  return [0, 1, 2].map((i) => column(m, i));
}

function times(a, b) {
  return a.map((row) => [0, 1, 2].map((j) => dot(row, column(b, j))));
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** The rotation next to a matrix that rounding has bent: many small turns add up. */
function straightened(m) {
  const unit = (v) => v.map((one) => one / Math.hypot(...v));
  const z = unit(column(m, 2));
  const y0 = column(m, 1);
  const y = unit(y0.map((one, axis) => one - dot(y0, z) * z[axis]));
  const x = cross(y, z);
  return [0, 1, 2].map((i) => [x[i], y[i], z[i]]);
}

function toMatrix(rotation, place) {
  return [...rotation.map((row, i) => [...row, place[i]]), [0, 0, 0, 1]];
}
