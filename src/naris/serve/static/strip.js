// The strip of keyframes: saved, named, put in order, gone to, played, kept in the file of the server.

import { merged } from "./merge.js";
import { askJson, askPicture, Refused } from "./talk.js";

const THUMB = { width: 192, height: 144 };
const MOST_TRIES = 3;

export class Strip {
  /**
   * `host` has: pose(), lens() as the server takes it, go(pose), say(text, isWrong, offer), changed(keyframes), and
   * `place`, by which what is not saved yet is kept in the browser.
   */
  constructor(list, host) {
    this.list = list;
    this.host = host;
    this.revision = "";
    this.keyframes = []; // {name, pose, picture}
    this.known = []; // as the server had them last
    this.saving = Promise.resolve();
    this.isSaving = false;
    this.unsaved = false;
    this.lacksPictures = false;
  }

  /** What the server has, with what an earlier page could not save. */
  async load() {
    const told = await askJson("/api/keyframes");
    const left = this.#left();
    this.revision = told.revision;
    this.known = told.keyframes;
    this.keyframes = (left ? merged(left.known, left.keyframes, told.keyframes) : told.keyframes).map((one) => ({ ...one, picture: null }));
    if (left && plain(this.keyframes) !== plain(told.keyframes)) {
      this.#changed("what was changed while the server was away is saved");
    } else {
      this.#forget();
      this.#show();
    }
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
    const [one] = this.keyframes.splice(at, 1);
    this.#changed();
    this.#focus(Math.min(at, this.keyframes.length - 1), ".go");
    this.host.say(`keyframe ${one.name} deleted`, false, {
      label: "Undo",
      press: () => {
        this.keyframes.splice(Math.min(at, this.keyframes.length), 0, one);
        this.#changed();
        this.#focus(this.keyframes.indexOf(one), ".go");
      },
    });
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
    this.#focus(to, by < 0 ? ".earlier" : ".later");
  }

  /** The server answers again: what it refused meanwhile is asked for anew. */
  retry() {
    if (this.lacksPictures) this.#show();
    if (this.unsaved && !this.isSaving) this.#keepLater("what was changed meanwhile is saved");
  }

  #focus(at, what) {
    this.list.children[at]?.querySelector(what)?.focus();
  }

  #changed(said = "") {
    this.#show();
    this.#keepLater(said);
  }

  /** Writes what there is then, after what is being written now. */
  #keepLater(said = "") {
    this.unsaved = true;
    this.#leave();
    this.saving = this.saving.then(async () => {
      this.isSaving = true;
      await this.#keep(said);
      if (!this.unsaved) this.#forget();
    }).catch((error) => {
      this.unsaved = true;
      this.host.say(`not saved: ${error.message}`, true);
    }).finally(() => (this.isSaving = false));
  }

  async #keep(said) {
    for (let tries = 0; this.unsaved && tries < MOST_TRIES; tries++) {
      this.unsaved = false;
      const keyframes = bare(this.keyframes);
      try {
        const told = await askJson("/api/keyframes", "PUT", { revision: this.revision, keyframes });
        this.revision = told.revision;
        this.known = told.keyframes;
        if (said) this.host.say(said);
      } catch (error) {
        if (!(error instanceof Refused) || tries === MOST_TRIES - 1) throw error;
        await this.#takeIn(error);
      }
    }
  }

  /** What was changed elsewhere meanwhile, with what is here; gives up where nothing was. */
  async #takeIn(error) {
    const told = await askJson("/api/keyframes");
    if (told.revision === this.revision) throw error;
    this.revision = told.revision;
    this.keyframes = merged(this.known, this.keyframes, told.keyframes);
    this.known = told.keyframes;
    this.unsaved = true;
    this.#show();
  }

  /** In the browser, should the page end before the server has them. */
  #leave() {
    localStorage.setItem(this.host.place, JSON.stringify({ known: this.known, keyframes: bare(this.keyframes) }));
  }

  #left() {
    try {
      return JSON.parse(localStorage.getItem(this.host.place));
    } catch {
      return null; // of another version
    }
  }

  #forget() {
    localStorage.removeItem(this.host.place);
  }

  #show() {
    this.lacksPictures = false;
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
    this.#picture(one).then((url) => (picture.src = url), () => (this.lacksPictures = true));
    go.append(picture);
    const name = document.createElement("input");
    name.value = one.name;
    name.maxLength = 80;
    name.setAttribute("aria-label", `name of keyframe ${one.name}`);
    name.addEventListener("change", () => (name.value = this.rename(one, name.value)));
    const row = document.createElement("div");
    row.append(
      name,
      button("earlier", `keyframe ${one.name} earlier`, () => this.shift(at, -1), "‹"),
      button("later", `keyframe ${one.name} later`, () => this.shift(at, 1), "›"),
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

/** As the server has them: without pictures. */
function bare(keyframes) {
  return keyframes.map(({ name, pose }) => ({ name, pose }));
}

function plain(keyframes) {
  return JSON.stringify(bare(keyframes));
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
