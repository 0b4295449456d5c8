// The page: what was loaded, the loop, and everything that can be pressed.

import { unpack } from "./parcel.js";
import { ask, askJson, askPicture, Latest, onConnection, Refused, sendFile } from "./talk.js";
import { Room } from "./room.js";
import { between, Flight, project } from "./flight.js";
import { help, Keys, PROFILES } from "./keys.js";
import { geometryOf, Inside, lensOf, paletteOf, straightened } from "./inside.js";
import { Outside } from "./outside.js";
import { Slices } from "./slices.js";
import { Brush } from "./brush.js";
import { Video, VIDEO } from "./video.js";
import { button, Strip } from "./strip.js";

const $ = (id) => document.getElementById(id);
const STILL_MS = 250, LONGEST_S = 0.1, DRAG_RAD_PER_PX = 0.004, WHEEL_MM = 0.6, WHEEL_PX = 100, FLY_MS = 350;
const PLAY_MM_S = 8, HASTE = 3, SLOW_MS = 45, QUICK_MS = 22, LEAST_RATIO = 0.3, OUTSIDE_MS = 500, EXACT_PX = 640, PAINT_TINT = 50, SAY_MS = 6000, WATCH_MS = 2000, DEAD_ZONE = 0.15;

const state = {
  fov: 70, playing: null, flying: null, exact: false, stillSince: 0, wasTold: false, lastDraw: 0, drawn: 0, marks: 0,
  view: "", beside: "", look: 0, strokes: 0, strokesDrawn: 0, ratio: 1, isRough: false, paused: false, keyframes: [], dropped: false,
  keepUntil: 0, outsideAt: 0,
};

const drawing = new Latest(), believing = new Latest(), locating = new Latest();

/** Runs the page; what cannot be is said in it. */
async function begin() {
  theme(localStorage.getItem("naris-theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  if (!document.createElement("canvas").getContext("webgl2")) {
    $("here").textContent = "This browser has no WebGL 2: open the page in a current Firefox, Chrome, Edge or Safari.";
    return;
  }
  const [start, surface, look] = await Promise.all([
    askJson("/api/start"), binary("/api/parcel/surface"), binary("/api/parcel/look"),
  ]);
  const about = surface.about;
  document.title = `${about.name} – naris steer`;
  $("name").textContent = about.name;
  $("missing").textContent = about.missing.map((one) => `This anatomy has ${one}.`).join("\n");
  const geometry = geometryOf(surface), palette = paletteOf(about);
  const inside = new Inside($("inside-canvas"), geometry, palette, look);
  const outside = new Outside($("outside-canvas"), geometry, palette, surface);
  const room = new Room(await binary("/api/parcel/room"));
  const flight = new Flight(room, bookmarked(start.digest) ?? start.pose);
  const page = { start, surface, about, inside, outside, room, flight, keys: new Keys(), slices: null };
  page.brush = new Brush(surface, geometry, room, {
    drawn: () => state.strokes++, changed: (said) => repainted(page, said), complain,
  });
  if (start.undoable !== null) brushed(page, start.undoable);
  if (start.hasSlices) page.slices = new Slices($("slices-canvas"), complain);
  page.strip = new Strip($("strip"), {
    pose: () => flight.pose,
    fovDeg: () => Math.min(state.fov, 140),
    go: (pose) => fly(page, pose),
    say,
    changed: (keyframes) => {
      state.keyframes = keyframes;
      outside.mark(keyframes.map((one) => one.pose));
      state.marks++;
    },
  });
  page.video = new Video($("video"), $("video-player"), $("video-name"),
    (picture, name) => locate(page, picture, name).catch(complain), (sentence) => say(sentence, true));
  $("video-close").addEventListener("click", () => {
    locating.end();
    page.video.close();
  });
  controls(page);
  pointers(page);
  dropping(page);
  await page.strip.load();
  sizes(page);
  for (const id of ["inside-canvas", "outside-canvas"]) new ResizeObserver(() => sizes(page)).observe($(id));
  onConnection((lost) => ($("lost").hidden = !lost));
  watch();
  addEventListener("hashchange", () => {
    const pose = bookmarked(start.digest);
    if (pose) fly(page, pose);
  });
  $("inside-canvas").focus();
  requestAnimationFrame((now) => loop(page, now));
  expose(page);
}

async function binary(path) {
  return unpack(await ask(path, {}, (answer) => answer.arrayBuffer()));
}

// --- the loop -------------------------------------------------------------------------------------------------------

function loop(page, now) {
  const spent = now - state.lastDraw;
  state.lastDraw = now;
  step(page, Math.min(spent / 1000, LONGEST_S), now);
  if (!state.paused) draw(page, now, spent);
  requestAnimationFrame((next) => loop(page, next));
}

/** Moves by what is held for so many seconds. */
function step(page, seconds, now) {
  const { flight, keys } = page;
  if (state.flying) return flying(page, now);
  if (state.playing) return playing(page, seconds);
  const wish = keys.wish;
  gamepad(wish);
  flight.advance(wish, seconds, keys.haste ? HASTE : 1);
}

/** Draws what has changed; while it changes no finer than it can be done quickly, at rest as fine as the screen. */
function draw(page, now, spent) {
  const { flight, inside, outside } = page;
  const pose = flight.pose;
  const view = viewOf(page, pose);
  const beside = `${view} ${outside.turn} ${outside.reach} ${state.marks} ${state.strokes}`;
  const moves = view !== state.view;
  if (moves || state.isRough || state.strokes !== state.strokesDrawn) {
    if (moves) smoother(page, spent);
    else if (now - state.stillSince > STILL_MS) refine(page, fullRatio());
    inside.draw(pose, state.fov);
    state.strokesDrawn = state.strokes;
    state.drawn++;
  }
  if (moves) outside.follow(flight.position, flight.shaft);
  // Where drawing is slow, what the scope sees goes before where it is.
  const mayWait = moves && state.isRough && now - state.outsideAt < OUTSIDE_MS;
  if (beside !== state.beside && !mayWait) {
    outside.draw(pose, state.fov, inside.size[0] / inside.size[1]);
    state.outsideAt = now;
    state.beside = beside;
  }
  state.view = viewOf(page, pose);
  if (moves) {
    state.stillSince = now;
    state.wasTold = false;
    leave(page);
    told(page, pose);
    page.slices?.follow(flight.position);
  } else if (!state.wasTold && now - state.stillSince > STILL_MS) {
    state.wasTold = true;
    atRest(page, pose);
  }
}

/** All that the inside view depends on. */
function viewOf({ inside }, pose) {
  return `${pose.flat().map((one) => one.toFixed(4))} ${state.fov} ${state.look} ${inside.size}`;
}

/** Coarser where a frame takes long, finer again where it does not. */
function smoother(page, spent) {
  if (spent > SLOW_MS) refine(page, Math.max(state.ratio * 0.8, LEAST_RATIO));
  else if (spent < QUICK_MS) refine(page, Math.min(state.ratio * 1.1, fullRatio()));
}

function refine(page, ratio) {
  state.isRough = ratio < fullRatio() - 1e-6;
  if (Math.abs(ratio - state.ratio) < 1e-6) return;
  state.ratio = ratio;
  const box = $("inside-canvas").getBoundingClientRect();
  page.inside.resize(Math.round(box.width), Math.round(box.height), ratio);
}

function fullRatio() {
  return Math.min(devicePixelRatio, 2);
}

function told(page, pose) {
  const { flight, room, about } = page;
  const label = room.region(flight.position);
  $("here").textContent = label < 0 ? (about.regions.length ? "in no region" : "") : about.regions[label].name;
  for (const item of $("regions").children) item.setAttribute("aria-current", String(Number(item.dataset.number) === label));
  const p = flight.position.map((one) => one.toFixed(1)).join(", ");
  $("numbers").textContent =
    `${p} mm (${about.frame}) · wall ${room.distance(flight.position).toFixed(1)} mm · inserted ${flight.inserted.toFixed(1)} mm`;
}

/** What was said of where the scope was is of no use here: it fades, and answers that are on their way do not count. */
function leave(page) {
  drawing.end();
  $("exact").classList.add("old");
  if (state.flying || performance.now() < state.keepUntil) return;
  state.dropped = false;
  believing.end();
  for (const meter of document.querySelectorAll("#regions meter")) meter.classList.add("old");
}

/** What is asked of the server only once the scope stands still. */
function atRest(page, pose) {
  history.replaceState(null, "", bookmark(page.start.digest, pose));
  if (state.exact) showExact(page, pose);
  if (page.start.hasModel && !state.dropped) {
    askJson("/api/believed", "POST", { pose }, believing.next()).then((said) => showBelief(page, said)).catch(complain);
  }
}

// --- going somewhere ------------------------------------------------------------------------------------------------

/** To a pose, so that one sees the way; straight through whatever lies between. */
function fly(page, pose) {
  page.flight.remember();
  state.playing = null;
  state.flying = { from: page.flight.pose, to: pose, begun: null };
}

function flying(page, now) {
  const way = state.flying;
  way.begun ??= now;
  const t = Math.min((now - way.begun) / FLY_MS, 1);
  page.flight.setPose(between(way.from, way.to, t * t * (3 - 2 * t)));
  if (t === 1) {
    state.flying = null;
    page.flight.inserted = 0;
  }
}

async function play(page) {
  if (state.playing) return (state.playing = null);
  try {
    await page.strip.saving;
    const { poses } = await askJson("/api/trajectory?step_mm=1");
    page.flight.remember();
    state.playing = { poses, at: 0 };
  } catch (error) {
    complain(error);
  }
}

function playing(page, seconds) {
  const way = state.playing;
  way.at += seconds * PLAY_MM_S;
  const low = Math.floor(way.at);
  if (low >= way.poses.length - 1) {
    page.flight.setPose(way.poses[way.poses.length - 1]);
    state.playing = null;
    return;
  }
  page.flight.setPose(between(way.poses[low], way.poses[low + 1], way.at - low));
}

function bookmark(digest, pose) {
  const numbers = pose.slice(0, 3).flat().map((one) => Number(one.toFixed(5)));
  return `#in=${digest.slice(0, 12)}&pose=${numbers.join(",")}`;
}

/** The pose in the address, if it is of this anatomy. */
function bookmarked(digest) {
  const told = new URLSearchParams(location.hash.slice(1));
  const numbers = (told.get("pose") ?? "").split(",").map(Number);
  if (numbers.length !== 12 || !numbers.every(Number.isFinite)) return null;
  if (told.get("in") !== digest.slice(0, 12)) {
    say("the bookmark is of another anatomy: here is the start of this one", true);
    return null;
  }
  return [numbers.slice(0, 4), numbers.slice(4, 8), numbers.slice(8, 12), [0, 0, 0, 1]];
}

// --- what can be pressed --------------------------------------------------------------------------------------------

function controls(page) {
  const { flight, keys, about, inside } = page;
  listPlaces(page);
  $("places").addEventListener("change", (event) => {
    const k = Number(event.target.value);
    fly(page, k ? about.places[k - 1].pose : page.start.pose);
    $("inside-canvas").focus();
  });
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
  $("profile").addEventListener("change", () => {
    keys.releaseAll();
    keys.profile = $("profile").value;
    localStorage.setItem("naris-keys", keys.profile);
    $("inside-canvas").focus();
  });
  slider("fov", "fov-out", (v) => `${v}°`, (v) => (state.fov = v));
  slider("barrel", "barrel-out", (v) => `${v} %`, (v) => (inside.barrel = v / 100));
  slider("light", "light-out", (v) => `${(2 ** v).toFixed(1)}×`, (v) => (inside.brightness = 2 ** v));
  slider("tint", "tint-out", (v) => `${v} %`, (v) => (inside.tint = v / 100));
  for (const id of ["slices", "slices-controls"]) $(id).hidden = page.slices === null;
  slider("span", "span-out", (v) => `${v} mm`, (v) => page.slices?.set("span_mm", v));
  slider("level", "level-out", (v) => `${v} HU`, (v) => page.slices?.set("level", v));
  slider("window", "window-out", (v) => `${v} HU`, (v) => page.slices?.set("width", v));
  slider("brush-radius", "brush-radius-out", (v) => `${v} mm`, (v) => (page.brush.radius = v));
  slider("post", "post-out", (v) => `${v}°`, () => optics(flight));
  $("optics").addEventListener("change", () => optics(flight));
  $("through").addEventListener("change", () => (flight.throughWalls = $("through").checked));
  for (const [id, name] of [["save", "save"], ["undo", "undo"], ["exact-button", "exact"], ["play", "play"], ["brush", "brush"], ["help-button", "help"]]) {
    $(id).addEventListener("click", commands[name]);
  }
  $("help-close").addEventListener("click", () => $("help").close());
  $("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
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
  $("brush-region").addEventListener("change", () => (page.brush.region = Number($("brush-region").value)));
  $("brush-undo").addEventListener("click", () => page.brush.undo());
  $("brush-save").addEventListener("click", () => saveRegions(page));
  $("simulate-row").hidden = !page.start.hasSimulate;
  $("simulate").addEventListener("click", () => simulate(page));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target) || $("help").open) return;
    if (keys.press(event.code, event.shiftKey, event.key, event.repeat)) event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    keys.release(event.code);
    keys.haste = event.shiftKey;
  });
  addEventListener("blur", () => keys.releaseAll());
}

function listPlaces(page) {
  const all = [{ name: "the start" }, ...page.about.places];
  $("places").replaceChildren(...all.map(({ name, kind }, k) => new Option(kind === "region" ? `${name} (region)` : name, k)));
}

function isTyping(element) {
  return element instanceof HTMLElement && element.matches("input:not([type=checkbox]), select, textarea, video");
}

function slider(id, out, words, act) {
  const set = () => {
    $(out).textContent = words(Number($(id).value));
    act(Number($(id).value));
    state.look++;
  };
  $(id).addEventListener("input", set);
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

function flyInto(page, number) {
  const name = page.about.regions[number]?.name;
  const place = page.about.places.find((one) => one.kind === "region" && one.name === name);
  if (place) fly(page, place.pose);
  else say(name === undefined ? "there is no region" : `no passage leads into ${name}`, true);
}

// --- painting regions -----------------------------------------------------------------------------------------------

function painting(page) {
  const { brush, outside } = page;
  if (!page.about.regions.length) return say("this anatomy has no regions to paint: start naris steer with --regions slabs", true);
  brush.isOn = !brush.isOn;
  if (!brush.isOn) brush.end();
  outside.brush = brush.isOn ? brush : null;
  $("brush").setAttribute("aria-pressed", String(brush.isOn));
  $("brush-controls").hidden = !brush.isOn;
  if (!brush.isOn || Number($("tint").value) >= PAINT_TINT) return;
  $("tint").value = String(PAINT_TINT); // one must see what one paints
  $("tint").dispatchEvent(new Event("input"));
}

/** The regions are others: where they are entered, and what is drawn, too. */
function repainted(page, said) {
  page.about.places.splice(0, Infinity, ...said.places);
  listPlaces(page);
  brushed(page, said.undoable);
  told(page, page.flight.pose);
  if (said.changed === 0) say("nothing there was painted: it has that region, or no air is near", true);
}

function brushed(page, strokes) {
  page.brush.strokes = strokes;
  $("brush-undo").disabled = strokes === 0;
  $("brush-save").disabled = false;
}

async function saveRegions(page) {
  try {
    const file = await page.brush.save();
    say(`${file}, beside the keyframes: give it as --regions`);
  } catch (error) {
    complain(error);
  }
}

function showHelp(profile) {
  $("help-table").replaceChildren(...help(profile).map((row) => {
    const line = document.createElement("tr");
    line.append(...row.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return line;
  }));
  $("help").showModal();
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  localStorage.setItem("naris-theme", name);
}

function say(text, isWrong = false) {
  $("message").textContent = text;
  $("message").className = isWrong ? "wrong" : "";
  $("message").hidden = false;
  clearTimeout(state.saying);
  state.saying = setTimeout(() => ($("message").hidden = true), SAY_MS);
}

function complain(error) {
  if (error.name === "AbortError") return; // another question took its place
  if (!(error instanceof Refused)) throw error;
  say(error.message, true);
}

// --- mouse, touch, gamepad ------------------------------------------------------------------------------------------

function pointers(page) {
  const canvas = $("inside-canvas"), { flight, outside } = page;
  const fingers = new Map(), { brush } = page;
  let dragged = 0, painter = null; // the pointer that paints
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (painter !== null) {
      brush.cancel(); // two fingers insert, and paint nothing
      painter = null;
    } else if (brush.isOn && !event.shiftKey && !fingers.size) {
      painter = event.pointerId;
      brush.begin(wallInside(page, rayOf(page, event)).place);
    }
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    dragged = 0;
    canvas.focus();
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const spread = pinch(fingers);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const by = [event.clientX - last[0], event.clientY - last[1]];
    dragged += Math.abs(by[0]) + Math.abs(by[1]);
    if (painter === event.pointerId) brush.move(wallInside(page, rayOf(page, event)).place);
    else if (fingers.size === 2) flight.move([0, 0, (pinch(fingers) - spread) * 0.05]);
    else flight.turn([by[1] * DRAG_RAD_PER_PX, -by[0] * DRAG_RAD_PER_PX, 0]);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => {
      fingers.delete(event.pointerId);
      if (painter !== event.pointerId) return;
      brush.end();
      painter = null;
    });
  }
  canvas.addEventListener("click", (event) => {
    if (dragged >= 4 || brush.isOn) return;
    const { label } = wallInside(page, rayOf(page, event));
    if (label >= 0) flyInto(page, label);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    flight.move([0, 0, (-WHEEL_MM * event.deltaY) / WHEEL_PX]);
  }, { passive: false });
  $("outside-canvas").addEventListener("click", (event) => {
    if (outside.dragged >= 4 || brush.isOn) return;
    const met = outside.hit(event);
    if (met) intoRegionOf(page, page.surface.arrays.region[met.corner]);
  });
}

function pinch(fingers) {
  if (fingers.size !== 2) return 0;
  const [a, b] = [...fingers.values()];
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

function intoRegionOf(page, label) {
  if (label < page.about.regions.length) flyInto(page, label);
  else say("that wall is of no region", true);
}

/** The ray of a click in the inside view, in the camera. */
function rayOf(page, event) {
  const box = $("inside-canvas").getBoundingClientRect();
  const lens = lensOf(page.inside.barrel, state.fov, box.width / box.height), scale = (2 * lens.reach[1]) / box.height;
  const bent = [(event.clientX - box.left - box.width / 2) * scale, (event.clientY - box.top - box.height / 2) * scale];
  const to = Math.hypot(...bent), by = to > 0 ? straightened(to, lens.k1) / to : 1;
  return [bent[0] * by, bent[1] * by, 1];
}

/** Where a ray of the camera meets the wall, and in which region: marched through the distances, as far as there is air. */
function wallInside(page, ray) {
  const pose = page.flight.pose;
  const length = Math.hypot(...ray);
  const way = [0, 1, 2].map((i) => (pose[i][0] * ray[0] + pose[i][1] * ray[1] + pose[i][2] * ray[2]) / length);
  let label = -1, far = 0;
  for (let k = 0; k < 400; k++) {
    const p = page.flight.position.map((one, axis) => one + far * way[axis]);
    const free = page.room.distance(p);
    const here = page.room.region(p);
    if (here >= 0) label = here;
    if (free < 0.15) break;
    far += Math.max(free * 0.9, 0.1);
  }
  return { label, place: page.flight.position.map((one, axis) => one + far * way[axis]) };
}

function gamepad(wish) {
  for (const pad of navigator.getGamepads?.() ?? []) {
    if (!pad?.connected) continue;
    const axis = (k) => (Math.abs(pad.axes[k] ?? 0) > DEAD_ZONE ? pad.axes[k] : 0);
    const pressed = (k) => pad.buttons[k]?.value ?? 0;
    wish.move[0] += axis(0);
    wish.move[2] -= axis(1);
    wish.move[1] += pressed(6) - pressed(7);
    wish.turn[1] += axis(2);
    wish.turn[0] -= axis(3);
    wish.turn[2] += pressed(5) - pressed(4);
  }
}

// --- what the server makes ------------------------------------------------------------------------------------------

function exact(page) {
  state.exact = !state.exact;
  $("exact-button").setAttribute("aria-pressed", String(state.exact));
  $("exact").hidden = !state.exact;
  if (state.exact) showExact(page, page.flight.pose);
}

async function showExact(page, pose) {
  const [w, h] = page.inside.size, shrink = Math.min(EXACT_PX / Math.max(w, h), 1);
  const { k1 } = lensOf(page.inside.barrel, state.fov, w / h);
  const asked = { pose, fov_deg: state.fov, k1, width: Math.round(w * shrink), height: Math.round(h * shrink), steady: false };
  try {
    const url = URL.createObjectURL(await askPicture("/api/frame", asked, drawing.next()));
    URL.revokeObjectURL($("exact-picture").src);
    $("exact-picture").src = url;
    $("exact").classList.remove("old");
  } catch (error) {
    complain(error);
  }
}

function showBelief(page, said) {
  for (const item of $("regions").children) {
    const meter = item.querySelector("meter");
    const at = said.regions.indexOf(page.about.regions[Number(item.dataset.number)].name);
    meter.hidden = at < 0;
    meter.classList.remove("old");
    if (at >= 0) {
      meter.value = said.probabilities[at];
      meter.title = `${Math.round(100 * said.probabilities[at])} %`;
    }
  }
  if (!page.about.regions.some((one) => said.regions.includes(one.name))) {
    say(`the model names other regions (${said.regions.join(", ")}): start naris steer without --regions`, true);
  }
  $("doubt").hidden = said.outOfDomain === null;
  if (said.outOfDomain !== null) $("doubt").textContent = `unlike what the model knows: ${Math.round(100 * said.outOfDomain)} %`;
}

function dropping(page) {
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    takeAll(page, [...event.dataTransfer.files]);
  });
}

/** One after the other, 9 before 10: keyframes keep the order of their names. */
async function takeAll(page, files) {
  files.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
  for (const file of files) await take(page, file);
}

/** A file that was dropped or chosen: keyframes, or a picture or video for the model to locate. */
async function take(page, file) {
  try {
    if (/\.(json|txt)$/i.test(file.name)) {
      const { keyframes } = await sendFile(`/api/keyframes/import?name=${encodeURIComponent(file.name)}`, file);
      page.strip.add(keyframes);
      say(`${keyframes.length} keyframes from ${file.name}`);
      return;
    }
    if (!page.start.hasModel) return say("expected a model to locate with, got none: start naris steer with --model", true);
    if (file.type.startsWith("video/") || VIDEO.test(file.name)) page.video.open(file);
    else await locate(page, file, file.name);
  } catch (error) {
    complain(error);
  }
}

/** Where the model believes that a picture is from: told, shown, and flown to. */
async function locate(page, picture, name) {
  const said = await sendFile("/api/locate", picture, locating.next());
  state.dropped = true; // what is said of a picture stays until one moves on
  state.keepUntil = performance.now() + FLY_MS + STILL_MS;
  believing.end();
  showBelief(page, said);
  showGhosts(page, said.hypotheses);
  const best = said.probabilities.indexOf(Math.max(...said.probabilities));
  say(`${name}: ${said.regions[best]} (${Math.round(100 * said.probabilities[best])} %)`);
  if (said.hypotheses.length) fly(page, said.hypotheses[0].pose);
}

/** What a model believes in: frustums in the outside view, and a button to fly to each. */
function showGhosts(page, hypotheses) {
  page.outside.mark(hypotheses.map((one) => one.pose), true);
  state.marks++;
  $("ghosts").replaceChildren(...hypotheses.map(({ pose, weight }, k) => {
    const item = document.createElement("li");
    item.append(button("", `fly to hypothesis ${k + 1}`, () => fly(page, pose), `hypothesis ${k + 1} · ${Math.round(100 * weight)} %`));
    return item;
  }));
  $("ghosts-title").hidden = !hypotheses.length;
}

async function exported(page, kind, name) {
  try {
    await page.strip.saving;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await ask(`/api/keyframes/export/${kind}`));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), SAY_MS);
  } catch (error) {
    complain(error);
  }
}

async function simulate(page) {
  try {
    await page.strip.saving;
    const per_position = Math.min(Math.max(Math.round(Number($("per-position").value)) || 10, 1), 1000);
    showWork(await askJson("/api/simulate", "POST", { per_position, step_mm: 1 }));
  } catch (error) {
    complain(error);
  }
}

/** Asks how far the pictures are, again and again; that is also how a lost connection is noticed. */
async function watch() {
  for (let work = {}; ; ) {
    try {
      work = await askJson("/api/simulate");
      showWork(work);
    } catch (error) {
      complain(error);
    }
    await new Promise((done) => setTimeout(done, work.running ? WATCH_MS / 4 : WATCH_MS));
  }
}

function showWork(work) {
  $("progress").hidden = !work.running;
  $("simulate").disabled = work.running;
  if (work.total) {
    $("progress").max = work.total;
    $("progress").value = work.done;
  } else {
    $("progress").removeAttribute("value");
  }
  $("simulated").textContent = work.running ? `${work.done} of ${work.total || "…"} pictures` : work.said;
}

// --- sizes, and a handle for scripts --------------------------------------------------------------------------------

function sizes(page) {
  state.ratio = fullRatio();
  state.isRough = false;
  for (const [view, id] of [[page.inside, "inside-canvas"], [page.outside, "outside-canvas"]]) {
    const box = $(id).getBoundingClientRect();
    view.resize(Math.round(box.width), Math.round(box.height), fullRatio());
  }
  state.view = state.beside = "";
}

/** `window.naris`: the page for scripts, as its tests drive it. */
function expose(page) {
  window.naris = {
    page,
    state,
    pose: () => page.flight.pose,
    go: (pose) => page.flight.jump(pose),
    step: (seconds) => step(page, seconds, performance.now()),
    lens: lensOf,
    take: (file) => take(page, file),
    project: (point) => project(page.flight.pose, point, state.fov),
    distance: () => page.room.distance(page.flight.position),
    region: () => page.room.region(page.flight.position),
    /** The picture as it is drawn at a size, as a data address. */
    picture(pose, fovDeg, width, height) {
      const before = [...page.inside.size];
      page.inside.resize(width, height);
      page.inside.draw(pose, fovDeg);
      const url = page.inside.renderer.domElement.toDataURL("image/png");
      page.inside.resize(...before);
      state.view = "";
      return url;
    },
  };
  document.documentElement.dataset.ready = "yes";
}

begin().catch((error) => {
  $("here").textContent = `this page has failed: ${error.message}`;
  throw error;
});
