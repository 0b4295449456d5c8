// What pages could not save, kept in the browser: each page has a slot of its own beside those of earlier ones.

const VERSION = "naris-keyframes/1";

export class Leftovers {
  /** `place` names the file that keyframes are kept in. */
  constructor(place) {
    this.prefix = `${VERSION} ${place} `;
    this.slot = `${this.prefix}${crypto.getRandomValues(new Uint32Array(2)).join("-")}`;
  }

  /** What is not saved yet, and from what it was changed. Where the browser keeps nothing, it is only in the page. */
  leave(known, keyframes) {
    try {
      localStorage.setItem(this.slot, JSON.stringify({ known, keyframes }));
    } catch {
      // Full, or forbidden.
    }
  }

  /** All that was left, by whichever page: {slot, known, keyframes}. */
  all() {
    const found = [];
    for (const slot of Object.keys(localStorage)) {
      if (!slot.startsWith(this.prefix)) continue;
      try {
        const { known, keyframes } = JSON.parse(localStorage.getItem(slot));
        if ([known, keyframes].every((list) => Array.isArray(list) && list.every(isKeyframe))) found.push({ slot, known, keyframes });
      } catch {
        // Not by naris.
      }
    }
    return found;
  }

  /** These, and what this page left, are saved. */
  forget(found = []) {
    for (const slot of [this.slot, ...found.map((one) => one.slot)]) localStorage.removeItem(slot);
  }
}

function isKeyframe(one) {
  const isRow = (row) => Array.isArray(row) && row.length === 4 && row.every(Number.isFinite);
  return typeof one?.name === "string" && Array.isArray(one.pose) && one.pose.length === 4 && one.pose.every(isRow);
}
