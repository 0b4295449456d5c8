// Slices of the CT through the scope: asked for as it moves, one at a time, the latest place last.

import { askPicture, Refused } from "./talk.js";

const SIZE_PX = 260, NEAR_MM = 0.05, INSET_PX = 9;
const EDGES = ["RLAP", "RLSI", "APSI"]; // of axial, coronal and sagittal: what is left, right, above and below

export class Slices {
  constructor(canvas, complain) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.complain = complain;
    this.settings = { span_mm: 80, level: 0, width: 2500 };
    this.waiting = null;
    this.asking = false;
    this.shown = null;
  }

  set(name, value) {
    this.settings[name] = value;
    if (this.shown) this.follow(this.shown, true);
  }

  /** The scope is here. */
  follow(place, always = false) {
    const moved = !this.shown || Math.hypot(...place.map((one, k) => one - this.shown[k])) > NEAR_MM;
    if (!moved && !always) return;
    this.shown = [...place];
    this.waiting = this.shown;
    if (!this.asking) this.#ask();
  }

  async #ask() {
    this.asking = true;
    try {
      while (this.waiting) {
        const place = this.waiting;
        this.waiting = null;
        const picture = await askPicture("/api/slices", { place, size: SIZE_PX, ...this.settings });
        this.#show(await createImageBitmap(picture));
      }
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.complain(error);
    } finally {
      this.asking = false;
    }
  }

  #show(picture) {
    const { canvas, context } = this;
    if (canvas.width !== picture.width) [canvas.width, canvas.height] = [picture.width, picture.height];
    context.drawImage(picture, 0, 0);
    context.strokeStyle = context.fillStyle = "#4fc3f7";
    Object.assign(context, { font: "bold 13px sans-serif", textAlign: "center", textBaseline: "middle" });
    const middle = SIZE_PX / 2;
    for (let k = 0; k < 3; k++) {
      const x = k * SIZE_PX + middle;
      context.beginPath();
      for (const [a, b] of [[-14, -4], [4, 14]]) {
        context.moveTo(x + a, middle);
        context.lineTo(x + b, middle);
        context.moveTo(x, middle + a);
        context.lineTo(x, middle + b);
      }
      context.stroke();
      const far = SIZE_PX - INSET_PX, left = k * SIZE_PX;
      [[INSET_PX, middle], [far, middle], [middle, INSET_PX], [middle, far]].forEach(([a, b], edge) =>
        context.fillText(EDGES[k][edge], left + a, b));
    }
  }
}
