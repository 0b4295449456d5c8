// The strip of keyframes: saved, named, put in order, gone to, played, kept in the file of the server.

import { askJson, askPicture, Refused } from "./talk.js";

const THUMB = { width: 192, height: 144 };
const MOST_TRIES = 3;

export class Strip {
  /** `host` has: pose(), lens() as the server takes it, go(pose), say(text, isWrong), changed(keyframes). */
  constructor(list, host) {
    this.list = list;
    this.host = host;
    this.revision = "";
    this.keyframes = []; // {name, pose, picture}
    this.saving = Promise.resolve();
    this.unsaved = false;
  }

  async load() {
    const told = await askJson("/api/keyframes");
    this.revision = told.revision;
    this.keyframes = told.keyframes.map((one) => ({ ...one, picture: null }));
    this.#show();
  }

  /** A keyframe of where the scope is now. */
  save() {
    const taken = new Set(this.keyframes.map((one) => one.name));
    let number = this.keyframes.length;
    while (taken.has(String(number).padStart(2, "0"))) number++;
    const name = String(number).padStart(2, "0");
    this.keyframes.push({ name, pose: this.host.pose(), picture: null });
    this.#changed(`keyframe ${name} saved`);
  }

  add(keyframes) {
    this.keyframes.push(...keyframes.map((one) => ({ ...one, picture: null })));
    this.#changed();
  }

  remove(at) {
    this.keyframes.splice(at, 1);
    this.#changed();
  }

  rename(one, name) {
    const trimmed = name.trim().slice(0, 80);
    if (trimmed && trimmed !== one.name) {
      one.name = trimmed;
      this.#keepLater();
    }
    return one.name; // nothing is drawn anew: a click may be on its way
  }

  shift(at, by) {
    const to = at + by;
    if (to < 0 || to >= this.keyframes.length) return;
    const [one] = this.keyframes.splice(at, 1);
    this.keyframes.splice(to, 0, one);
    this.#changed();
    this.list.children[to]?.querySelector(".go")?.focus();
  }

  #changed(said = "") {
    this.#show();
    this.#keepLater(said);
  }

  /** Writes what there is then, after what is being written now. */
  #keepLater(said = "") {
    this.unsaved = true;
    this.saving = this.saving.then(() => this.#keep(said)).catch((error) => {
      this.unsaved = true;
      this.host.say(`not saved: ${error.message}`, true);
    });
  }

  async #keep(said) {
    for (let tries = 0; this.unsaved && tries < MOST_TRIES; tries++) {
      this.unsaved = false;
      const keyframes = this.keyframes.map(({ name, pose }) => ({ name, pose }));
      try {
        const told = await askJson("/api/keyframes", "PUT", { revision: this.revision, keyframes });
        this.revision = told.revision;
        if (said) this.host.say(said);
      } catch (error) {
        if (!(error instanceof Refused) || tries === MOST_TRIES - 1) throw error;
        await this.#takeIn(error);
      }
    }
  }

  /** What was changed elsewhere meanwhile, beside what is here; gives up where nothing was. */
  async #takeIn(error) {
    const told = await askJson("/api/keyframes");
    if (told.revision === this.revision) throw error;
    this.revision = told.revision;
    const here = new Set(this.keyframes.map(({ name, pose }) => JSON.stringify([name, pose])));
    const others = told.keyframes.filter(({ name, pose }) => !here.has(JSON.stringify([name, pose])));
    this.keyframes.push(...others.map((one) => ({ ...one, picture: null })));
    this.unsaved = true;
    this.#show();
  }

  #show() {
    this.host.changed(this.keyframes);
    this.list.replaceChildren(...this.keyframes.map((one, at) => this.#item(one, at)));
  }

  #item(one, at) {
    const item = document.createElement("li");
    const go = button("go", `go to keyframe ${one.name}`, () => this.host.go(one.pose));
    const picture = document.createElement("img");
    picture.alt = `what keyframe ${one.name} sees`;
    picture.width = THUMB.width;
    picture.height = THUMB.height;
    this.#picture(one).then((url) => (picture.src = url), () => {});
    go.append(picture);
    const name = document.createElement("input");
    name.value = one.name;
    name.maxLength = 80;
    name.setAttribute("aria-label", `name of keyframe ${one.name}`);
    name.addEventListener("change", () => (name.value = this.rename(one, name.value)));
    const row = document.createElement("div");
    row.append(
      name,
      button("", `keyframe ${one.name} earlier`, () => this.shift(at, -1), "‹"),
      button("", `keyframe ${one.name} later`, () => this.shift(at, 1), "›"),
      button("", `delete keyframe ${one.name}`, () => this.remove(at), "×"),
    );
    item.append(go, row);
    return item;
  }

  async #picture(one) {
    one.picture ??= askPicture("/api/frame", { pose: one.pose, ...this.host.lens(), ...THUMB })
      .then((picture) => URL.createObjectURL(picture))
      .catch((error) => {
        one.picture = null; // asked for again when it is shown again
        throw error;
      });
    return one.picture;
  }
}

export function button(kind, label, press, text = "") {
  const made = document.createElement("button");
  made.type = "button";
  made.className = kind;
  made.setAttribute("aria-label", label);
  made.title = label;
  made.textContent = text;
  made.addEventListener("click", press);
  return made;
}
