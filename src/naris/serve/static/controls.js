// Everything in the page that can be pressed, chosen or slid.

import { $, say, state } from "./ui.js";
import { exact } from "./exact.js";
import { radians, rollOf } from "./flight.js";
import { help, PROFILES } from "./keys.js";
import { takeAll } from "./model.js";
import { painting, saveRegions } from "./painting.js";
import { ring, wallInside } from "./pointers.js";
import { fly, flyInto, listPlaces, play } from "./travel.js";
import { exported, simulate, stopSimulating } from "./work.js";

const SLIDES = /^(Arrow|Page|Home$|End$)/;

export function controls(page) {
  const { flight, keys, about, inside, outside } = page;
  listPlaces(page);
  choice("places", (k) => fly(page, Number(k) ? about.places[k - 1].pose : page.start.pose));
  $("regions").replaceChildren(...about.regions.map((one, number) => regionItem(page, one, number)));
  const commands = {
    save: () => page.strip.save(),
    undo: () => {
      state.flying = state.playing = null;
      if (!flight.undo()) say("there is no way back");
    },
    exact: () => exact(page),
    play: () => play(page),
    through: () => {
      $("through").checked = flight.throughWalls = !flight.throughWalls;
    },
    home: () => fly(page, page.start.pose),
    level: () => {
      const roll = rollOf(flight.pose);
      if (roll === null) say("looking straight up or down there is no level", true);
      else flight.turn([0, 0, -radians(roll)]);
    },
    brush: () => painting(page),
    dab: () => {
      if (!page.brush.isOn) return say("press B first to paint", true);
      if (page.brush.stroke) return;
      page.brush.begin(wallInside(page, [0, 0, 1]).place);
      page.brush.end();
    },
    help: () => showHelp(keys.profile),
    ...Object.fromEntries([0, 30, 45, 70].map((angle) => [`optics${angle}`, () => {
      $("optics").value = String(angle);
      optics(flight);
    }])),
  };
  keys.onCommand = (name) => commands[name]();
  keys.onStep = (move, turn) => {
    if (state.flying) return;
    flight.turn(turn);
    flight.move(move);
  };
  for (const [name, says] of Object.entries(PROFILES)) {
    const option = document.createElement("option");
    option.value = name;
    option.textContent = says;
    $("profile").append(option);
  }
  $("profile").value = keys.profile = localStorage.getItem("naris-keys") in PROFILES ? localStorage.getItem("naris-keys") : "wasd";
  choice("profile", (name) => {
    keys.releaseAll();
    keys.profile = name;
    localStorage.setItem("naris-keys", name);
  });
  slider("fov", "fov-out", (v) => `${v}°`, (v) => (state.fov = v));
  slider("barrel", "barrel-out", (v) => `${v} %`, (v) => (inside.barrel = v / 100));
  slider("light", "light-out", (v) => `${(2 ** v).toFixed(2)}×`, (v) => (inside.brightness = 2 ** v));
  slider("tint", "tint-out", (v) => `${v} %`, (v) => (inside.tint = v / 100));
  for (const id of ["slices", "slices-controls"]) $(id).hidden = page.slices === null;
  slider("span", "span-out", (v) => `${v} mm`, (v) => page.slices?.set("span_mm", v));
  slider("level", "level-out", (v) => `${v} HU`, (v) => page.slices?.set("level", v));
  slider("window", "window-out", (v) => `${v} HU`, (v) => page.slices?.set("width", v));
  slider("brush-radius", "brush-radius-out", (v) => `${v} mm`, (v) => {
    page.brush.radius = v;
    ring(page);
  });
  slider("post", "post-out", (v) => `${v}°`, () => optics(flight));
  choice("optics", () => optics(flight));
  $("through").addEventListener("change", () => (flight.throughWalls = $("through").checked));
  for (const [id, name] of [["save", "save"], ["undo", "undo"], ["exact-button", "exact"], ["play", "play"], ["brush", "brush"], ["help-button", "help"]]) {
    $(id).addEventListener("click", commands[name]);
  }
  $("help-close").addEventListener("click", () => $("help").close());
  $("theme").addEventListener("click", () => {
    theme(isDark() ? "light" : "dark");
    outside.shown(isDark());
    state.marks++;
  });
  outside.shown(isDark());
  $("import").addEventListener("click", () => $("file").click());
  $("file").addEventListener("change", () => {
    takeAll(page, [...$("file").files]);
    $("file").value = "";
  });
  for (const [id, kind, name] of [["export-json", "json", "keyframes.json"], ["export-original", "original", "keyframes.zip"]]) {
    $(id).addEventListener("click", () => exported(page, kind, name));
  }
  $("brush-row").hidden = !about.regions.length;
  $("brush-region").replaceChildren(...about.regions.map(({ name }, k) => new Option(name, k)));
  choice("brush-region", (k) => (page.brush.region = Number(k)));
  $("brush-undo").addEventListener("click", () => page.brush.undo());
  $("brush-save").addEventListener("click", () => saveRegions(page));
  $("simulate-row").hidden = !page.start.hasSimulate;
  $("simulate").addEventListener("click", () => simulate(page));
  $("simulate-stop").addEventListener("click", stopSimulating);
  document.addEventListener("keydown", (event) => {
    const isDone = event.key === "Escape" || (event.key === "Enter" && event.target.matches?.("input"));
    if (isDone && event.target.matches?.("input, select") && !$("help").open) setTimeout(back); // what was typed is taken first
    if ($("help").open && event.key === "?") return $("help").close();
    const isUndo = (event.ctrlKey || event.metaKey) && event.code === "KeyZ" && !event.shiftKey;
    if (isUndo && !takes(event.target, event.code) && page.strip.undelete()) event.preventDefault();
    if (event.ctrlKey || event.metaKey || event.altKey || takes(event.target, event.code) || $("help").open) return;
    if (keys.press(event.code, event.shiftKey, event.key, event.repeat)) event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    keys.release(event.code);
    keys.haste = event.shiftKey;
  });
  addEventListener("blur", () => keys.releaseAll());
}

/** A list: chosen with a pointer it gives the keys back to the scope; with keys one may go on through it. */
function choice(id, act) {
  let isPointed = false;
  $(id).addEventListener("pointerdown", () => (isPointed = true));
  $(id).addEventListener("keydown", () => (isPointed = false));
  $(id).addEventListener("change", () => {
    act($(id).value);
    if (isPointed) back();
    isPointed = false;
  });
}

/** The keyboard is the scope's again. */
function back() {
  $("inside-canvas").focus();
}

/** Whether a key is for the element that has the focus. */
function takes(element, code) {
  if (!(element instanceof HTMLElement)) return false;
  if (element.matches("input[type=range]")) return SLIDES.test(code);
  return element.matches("input:not([type=checkbox]), select, textarea, video");
}

function slider(id, out, words, act) {
  const set = () => {
    $(out).textContent = words(Number($(id).value));
    act(Number($(id).value));
    state.look++;
  };
  $(id).addEventListener("input", set);
  $(id).addEventListener("pointerup", back);
  set();
}

function optics(flight) {
  flight.setOptics(Number($("optics").value), Number($("post").value));
}

function regionItem(page, one, number) {
  const item = document.createElement("li");
  item.dataset.number = number;
  const go = document.createElement("button");
  go.type = "button";
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.background = one.colour;
  const label = document.createElement("span");
  label.className = "label";
  label.textContent = one.name;
  const meter = document.createElement("meter");
  meter.hidden = true;
  meter.setAttribute("aria-label", `probability of ${one.name}`);
  go.append(swatch, label, meter);
  go.title = `fly into ${one.name}`;
  go.addEventListener("click", () => flyInto(page, number));
  item.append(go);
  return item;
}

function showHelp(profile) {
  $("help-table").replaceChildren(...help(profile).map((row) => {
    const line = document.createElement("tr");
    line.append(...row.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return line;
  }));
  $("help").showModal();
  $("help").scrollTop = 0;
}

function isDark() {
  return document.documentElement.dataset.theme === "dark";
}

export function theme(name) {
  document.documentElement.dataset.theme = name;
  localStorage.setItem("naris-theme", name);
}
