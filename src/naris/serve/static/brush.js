// Painting regions: what a stroke changes is shown at once, and then as the server says that it is.

import { unpack } from "./parcel.js";
import { ask, askJson } from "./talk.js";

const APART = 0.3; // of the radius, between the places of a stroke
const MOST_POINTS = 1500; // a longer stroke is sent as several
const JSON_HEADERS = { "content-type": "application/json" };

export class Brush {
  /**
   * `drawn()` is called when walls are to be drawn anew, `changed(about)` with what the server said whenever the regions
   * are others.
   */
  constructor(surface, geometry, room, { drawn, changed, complain }) {
    Object.assign(this, { surface, geometry, room, drawn, changed, complain });
    this.isOn = false;
    this.region = 0;
    this.radius = 3;
    this.strokes = 0; // that the server knows of
    this.stroke = null; // that is being made
    this.waiting = []; // strokes that the server has not answered yet
    this.sending = Promise.resolve();
  }

  /** The first place of a stroke on a wall (mm); one that is being made ends. */
  begin(point) {
    this.end();
    this.stroke = { region: this.region, radius_mm: this.radius, points: [] };
    this.move(point);
  }

  /** Another place of the stroke, if it is far enough from the last one. */
  move(point) {
    const { stroke } = this;
    if (!stroke || !point) return;
    const last = stroke.points.at(-1);
    if (last && Math.hypot(...point.map((one, axis) => one - last[axis])) < APART * stroke.radius_mm) return;
    stroke.points.push(point);
    this.#preview(stroke, [point]);
    this.drawn();
    if (stroke.points.length < MOST_POINTS) return;
    this.end();
    this.stroke = { ...stroke, points: [point] };
  }

  /** The end of the stroke: it is sent. */
  end() {
    const { stroke } = this;
    this.stroke = null;
    if (!stroke?.points.length) return this.sending;
    this.waiting.push(stroke);
    return this.#ask("/api/regions/paint", () => stroke, stroke);
  }

  /** What is being made was no stroke. */
  cancel() {
    this.stroke = null;
    this.#show();
  }

  undo() {
    return this.#ask("/api/regions/undo", () => ({ strokes: this.strokes }), null);
  }

  /** Writes the set; gives its `file`, and what else the server says of the brush. */
  async save() {
    await this.sending;
    return askJson("/api/regions/save", "POST", {});
  }

  /** One after the other, so that the last answer is of the last stroke; one that fails stops none after it. */
  #ask(path, body, stroke) {
    this.sending = this.sending.then(async () => {
      try {
        const options = { method: "POST", headers: JSON_HEADERS, body: JSON.stringify(body()) };
        const { about, arrays } = unpack(await ask(path, options, (answer) => answer.arrayBuffer()));
        this.strokes = about.undoable;
        this.surface.arrays.region.set(arrays.surface);
        this.room.labels.set(arrays.room);
        this.changed(about);
      } catch (error) {
        queueMicrotask(() => this.complain(error));
      }
      this.waiting = this.waiting.filter((one) => one !== stroke);
      this.#show();
    });
    return this.sending;
  }

  /** The regions as the server told them, under the strokes that it has not answered yet. */
  #show() {
    this.geometry.getAttribute("region").array.set(this.surface.arrays.region);
    for (const stroke of [...this.waiting, this.stroke]) if (stroke) this.#preview(stroke, stroke.points);
    this.geometry.getAttribute("region").needsUpdate = true;
    this.drawn();
  }

  #preview({ region, radius_mm }, points) {
    const { vertices } = this.surface.arrays, shown = this.geometry.getAttribute("region");
    const within = radius_mm ** 2;
    for (const [x, y, z] of points) {
      for (let k = 0; k < shown.count; k++) {
        const off = (vertices[3 * k] - x) ** 2 + (vertices[3 * k + 1] - y) ** 2 + (vertices[3 * k + 2] - z) ** 2;
        if (off <= within) shown.array[k] = region;
      }
    }
    shown.needsUpdate = true;
  }
}
