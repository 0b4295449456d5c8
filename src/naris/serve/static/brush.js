// Painting regions: what a stroke changes is shown at once, and then as the server says that it is.

import { unpack } from "./parcel.js";
import { ask, askJson } from "./talk.js";

const APART = 0.3; // of the radius, between the places of a stroke
const JSON_HEADERS = { "content-type": "application/json" };

export class Brush {
  /** `changed(about)` is called with what the server said whenever the regions are others. */
  constructor(surface, geometry, room, changed, complain) {
    Object.assign(this, { surface, geometry, room, changed, complain });
    this.isOn = false;
    this.region = 0;
    this.radius = 3;
    this.points = null;
    this.sending = Promise.resolve();
  }

  /** The first place of a stroke on a wall (mm). */
  begin(point) {
    this.points = [];
    this.move(point);
  }

  /** Another place of the stroke, if it is far enough from the last one. */
  move(point) {
    if (!this.points || !point) return;
    const last = this.points.at(-1);
    if (last && Math.hypot(...point.map((one, axis) => one - last[axis])) < APART * this.radius) return;
    this.points.push(point);
    this.#preview(point);
  }

  /** The end of the stroke: it is sent. */
  end() {
    const points = this.points;
    this.points = null;
    if (!points?.length) return this.sending;
    return this.#ask("/api/regions/paint", { region: this.region, radius_mm: this.radius, points });
  }

  undo() {
    return this.#ask("/api/regions/undo", {});
  }

  /** Writes the set; gives the name of its file. */
  async save() {
    await this.sending;
    return (await askJson("/api/regions/save", "POST", {})).file;
  }

  /** One after the other, so that the last answer is of the last stroke. */
  #ask(path, body) {
    this.sending = this.sending.then(async () => {
      try {
        const options = { method: "POST", headers: JSON_HEADERS, body: JSON.stringify(body) };
        const { about, arrays } = unpack(await ask(path, options, (answer) => answer.arrayBuffer()));
        this.#take(arrays);
        this.changed(about);
      } catch (error) {
        this.complain(error);
      }
    });
    return this.sending;
  }

  #take({ surface, room }) {
    this.surface.arrays.region.set(surface);
    this.room.labels.set(room);
    const shown = this.geometry.getAttribute("region");
    shown.array.set(surface);
    shown.needsUpdate = true;
  }

  #preview([x, y, z]) {
    const { vertices } = this.surface.arrays, shown = this.geometry.getAttribute("region");
    const within = this.radius ** 2;
    for (let k = 0; k < shown.count; k++) {
      const off = (vertices[3 * k] - x) ** 2 + (vertices[3 * k + 1] - y) ** 2 + (vertices[3 * k + 2] - z) ** 2;
      if (off <= within) shown.array[k] = this.region;
    }
    shown.needsUpdate = true;
  }
}
