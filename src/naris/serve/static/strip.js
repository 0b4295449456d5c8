// The strip of keyframes: saved, named, put in order, gone to, played, kept in the file of the server.

import { Leftovers } from "./leftovers.js";
import { merged } from "./merge.js";
import { askJson, askPicture, Refused } from "./talk.js";

const THUMB = { width: 192, height: 144 };
const MOST_TRIES = 3;

export class Strip {
  /**
   * `host` has: pose(), lens() as the server takes it, go(pose), say(text, isWrong, offer), changed(keyframes), and
   * `place`, which names the file that they are kept in.
   */
  constructor(list, host) {
    this.list = list;
    this.host = host;
    this.revision = "";
    this.keyframes = []; // {name, pose, picture}
    this.known = []; // as the server had them last
    this.deleted = null; // the last one, and where it was
    this.saving = Promise.resolve();
    this.isSaving = false;
    this.unsaved = false;
    this.isFilling = false;
    this.leftovers = new Leftovers(host.place);
  }

  /** What the server has, with what earlier pages could not save. */
  async load() {
    const told = await askJson("/api/keyframes");
    const left = this.leftovers.all();
    this.revision = told.revision;
    this.known = told.keyframes;
    const both = left.reduce((there, one) => merged(one.known, one.keyframes, there), told.keyframes);
    this.keyframes = both.map((one) => ({ ...one, picture: null }));
    if (plain(both) === plain(told.keyframes)) {
      this.leftovers.forget(left);
      this.#show();
    } else {
      this.#changed("what was changed while the server was away is saved", left);
    }
  }

  /** When all is in the file. */
  async saved() {
    await this.saving;
    if (this.unsaved) throw new Refused("the keyframes are not saved yet: open the address that naris steer printed");
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
    this.deleted = { one, at };
    this.#changed();
    if (this.keyframes.length) this.#focus(Math.min(at, this.keyframes.length - 1), ".go");
    else this.host.back();
    this.host.say(`keyframe ${one.name} deleted`, false, { label: "Undo", press: () => this.undelete() });
  }

  /** Takes the last deletion back; whether there was one. */
  undelete() {
    if (!this.deleted) return false;
    const { one, at } = this.deleted;
    this.deleted = null;
    this.keyframes.splice(Math.min(at, this.keyframes.length), 0, one);
    this.#changed(`keyframe ${one.name} is there again`);
    this.#focus(this.keyframes.indexOf(one), ".go");
    return true;
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
    this.#fill();
    if (this.unsaved && !this.isSaving) this.#keepLater("what was changed meanwhile is saved");
  }

  #focus(at, what) {
    this.list.children[at]?.querySelector(what)?.focus();
  }

  #changed(said = "", left = []) {
    this.#keepLater(said, left);
    this.#show();
  }

  /** Writes what there is then, after what is being written now. */
  #keepLater(said = "", left = []) {
    this.unsaved = true;
    this.leftovers.leave(this.known, bare(this.keyframes));
    this.saving = this.saving.then(async () => {
      this.isSaving = true;
      await this.#keep(said);
      if (!this.unsaved) this.leftovers.forget(left);
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
        const told = await askJson("/api/keyframes", "PUT", { place: this.host.place, revision: this.revision, keyframes });
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

  /** Draws all of them; what is being typed stays. */
  #show() {
    const row = document.activeElement?.closest?.("#strip li"), typed = row?.contains(document.activeElement) && row.querySelector("input");
    const held = typed && typed === document.activeElement ? { key: row.dataset.pose, value: typed.value } : null;
    this.host.changed(this.keyframes);
    this.list.replaceChildren(...this.keyframes.map((one, at) => this.#item(one, at)));
    const again = held && [...this.list.children].find((one) => one.dataset.pose === held.key)?.querySelector("input");
    if (again) {
      again.focus();
      again.value = held.value;
    }
    this.#fill();
  }

  #item(one, at) {
    const item = document.createElement("li");
    item.dataset.pose = JSON.stringify(one.pose);
    const go = button("go", "", () => this.host.go(one.pose));
    const picture = document.createElement("img");
    picture.width = THUMB.width;
    picture.height = THUMB.height;
    if (one.picture) picture.src = one.picture;
    go.append(picture);
    const name = document.createElement("input");
    name.value = one.name;
    name.maxLength = 80;
    const earlier = button("earlier", "", () => this.shift(at, -1), "‹");
    const later = button("later", "", () => this.shift(at, 1), "›");
    const remove = button("delete", "", () => this.remove(at), "×");
    const label = () => {
      picture.alt = `what keyframe ${one.name} sees`;
      name.setAttribute("aria-label", `name of keyframe ${one.name}`);
      const told = [[go, `go to keyframe ${one.name}`], [earlier, `keyframe ${one.name} earlier`],
        [later, `keyframe ${one.name} later`], [remove, `delete keyframe ${one.name}`]];
      for (const [which, words] of told) {
        which.setAttribute("aria-label", words);
        which.title = words;
      }
    };
    name.addEventListener("change", () => {
      name.value = this.rename(one, name.value);
      label();
    });
    label();
    const row = document.createElement("div");
    row.append(name, earlier, later, remove);
    item.append(go, row);
    return item;
  }

  /** Asks for the pictures that are not there yet, one after the other, so that nothing else waits for them. */
  async #fill() {
    if (this.isFilling) return;
    this.isFilling = true;
    try {
      for (let one; (one = this.keyframes.find(({ picture }) => !picture)); ) {
        const seen = await askPicture("/api/frame", { pose: one.pose, ...this.host.lens(), ...THUMB });
        const at = this.keyframes.indexOf(one);
        if (at < 0) continue;
        one.picture = URL.createObjectURL(seen);
        this.list.children[at].querySelector("img").src = one.picture;
      }
    } catch (error) {
      if (!(error instanceof Refused)) throw error; // asked for again by `retry`
    } finally {
      this.isFilling = false;
    }
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
