// Which key does what, in two profiles, and the words of the help.

const ORIGINAL_RAD = 0.05; // of the published viewer, by key; with Shift 22.5 times that
const ORIGINAL_MM = 500 / 600;

// Held keys: what is wished for as long as they are down (move: right, down, inwards; turn: pitch, yaw, roll).
const HELD = {
  KeyW: { move: [0, 0, 1], says: "insert" },
  KeyS: { move: [0, 0, -1], says: "withdraw" },
  KeyA: { move: [-1, 0, 0], says: "to the left" },
  KeyD: { move: [1, 0, 0], says: "to the right" },
  PageUp: { move: [0, -1, 0], says: "up" },
  PageDown: { move: [0, 1, 0], says: "down" },
  ArrowUp: { turn: [1, 0, 0], says: "look up" },
  ArrowDown: { turn: [-1, 0, 0], says: "look down" },
  ArrowLeft: { turn: [0, -1, 0], says: "look left" },
  ArrowRight: { turn: [0, 1, 0], says: "look right" },
  KeyQ: { turn: [0, 0, -1], says: "roll counter-clockwise" },
  KeyE: { turn: [0, 0, 1], says: "roll clockwise" },
};

// The published viewer: one step for each press. There, x and s did nothing; here they roll.
const STEPS = {
  KeyW: { turn: [-ORIGINAL_RAD, 0, 0], says: "look down" },
  KeyQ: { turn: [ORIGINAL_RAD, 0, 0], says: "look up" },
  KeyZ: { turn: [0, -ORIGINAL_RAD, 0], says: "look left" },
  KeyA: { turn: [0, ORIGINAL_RAD, 0], says: "look right" },
  KeyX: { turn: [0, 0, ORIGINAL_RAD], says: "roll clockwise" },
  KeyS: { turn: [0, 0, -ORIGINAL_RAD], says: "roll counter-clockwise" },
  ArrowUp: { move: [0, 0, ORIGINAL_MM], says: "insert" },
  ArrowDown: { move: [0, 0, -ORIGINAL_MM], says: "withdraw" },
  ArrowLeft: { move: [-ORIGINAL_MM, 0, 0], says: "to the left" },
  ArrowRight: { move: [ORIGINAL_MM, 0, 0], says: "to the right" },
  PageUp: { move: [0, -ORIGINAL_MM, 0], says: "up" },
  PageDown: { move: [0, ORIGINAL_MM, 0], says: "down" },
};

const ORIGINAL_HASTE = 22.5;

const COMMANDS = {
  KeyC: { name: "save", says: "save a keyframe" },
  KeyU: { name: "undo", says: "back to where you were before the last jump" },
  KeyF: { name: "exact", says: "the exact picture of naris beside this one" },
  KeyP: { name: "play", says: "play the trajectory, or stop" },
  KeyB: { name: "brush", says: "paint regions, or not" },
  KeyV: { name: "dab", says: "while painting: paint where the scope looks" },
  KeyG: { name: "through", says: "through walls, or not" },
  KeyL: { name: "level", says: "level: roll until up is up" },
  Home: { name: "home", says: "to the start" },
  Digit1: { name: "optics0", says: "optics of 0°" },
  Digit2: { name: "optics30", says: "optics of 30°" },
  Digit3: { name: "optics45", says: "optics of 45°" },
  Digit4: { name: "optics70", says: "optics of 70°" },
  Slash: { name: "help", says: "this help" },
};

export const PROFILES = { wasd: "W A S D and Q E", original: "as in the published viewer" };

/** Keys as they are pressed and held, turned into wishes, steps and commands. */
export class Keys {
  constructor() {
    this.profile = "wasd";
    this.down = new Set();
    this.haste = false;
    this.onStep = () => {};
    this.onCommand = () => {};
  }

  /** A key went down; whether it means something here. */
  press(code, shift = false, key = "", isRepeated = false) {
    this.haste = shift;
    const command = key === "?" ? "Slash" : code;
    if (this.profile === "original" && STEPS[code]) {
      const { move = [0, 0, 0], turn = [0, 0, 0] } = STEPS[code];
      const by = shift ? ORIGINAL_HASTE : 1;
      this.onStep(move, turn.map((one) => one * by));
      return true;
    }
    if (this.profile === "wasd" && HELD[code]) {
      this.down.add(code);
      return true;
    }
    if (COMMANDS[command] && (command !== "Slash" || key === "?" || key === "")) {
      if (!isRepeated) this.onCommand(COMMANDS[command].name);
      return true;
    }
    return false;
  }

  release(code) {
    this.down.delete(code);
  }

  releaseAll() {
    this.down.clear();
    this.haste = false;
  }

  /** What all keys that are down ask for together. */
  get wish() {
    const wish = { move: [0, 0, 0], turn: [0, 0, 0] };
    for (const code of this.down) {
      for (const part of ["move", "turn"]) {
        const add = HELD[code][part];
        if (add) wish[part] = wish[part].map((one, axis) => one + add[axis]);
      }
    }
    return wish;
  }
}

/** Rows of the help: key and meaning. */
export function help(profile) {
  const steering = profile === "wasd" ? HELD : STEPS;
  const rows = Object.entries(steering).map(([code, { says }]) => [label(code), says]);
  rows.push(profile === "wasd" ? ["Shift", "three times as fast"] : ["Shift", "turns 22.5 times as far"]);
  for (const [code, { says }] of Object.entries(COMMANDS)) rows.push([label(code), says]);
  rows.push(["Ctrl Z", "takes the last deletion of a keyframe back"]);
  rows.push(["drag", "look around"], ["wheel", "insert, withdraw"], ["click", "into the region that was clicked"], ["drag while painting", "paints; with Shift it turns"]);
  rows.push(["touch", "one finger looks, two spread to insert and close to withdraw"], ["gamepad", "left stick moves, right stick looks, triggers up and down, shoulder buttons roll"]);
  rows.push(["outside, once Tab has come to it", "arrows turn it, + and − come nearer and go away"]);
  return rows;
}

function label(code) {
  const names = {
    ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", Slash: "?",
    PageUp: "Page ↑", PageDown: "Page ↓",
  };
  return names[code] ?? code.replace(/^(Key|Digit)/, "");
}
