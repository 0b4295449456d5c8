// The page: what is loaded, and the loop.

import { unpack } from "./parcel.js";
import { ask, askJson, onConnection } from "./talk.js";
import { Room } from "./room.js";
import { Flight, project, rollOf } from "./flight.js";
import { Keys } from "./keys.js";
import { geometryOf, Inside, lensOf, paletteOf } from "./inside.js";
import { Outside } from "./outside.js";
import { Slices } from "./slices.js";
import { Brush } from "./brush.js";
import { Video } from "./video.js";
import { Strip } from "./strip.js";
import { $, complain, say, state } from "./ui.js";
import { controls, theme } from "./controls.js";
import { drawing, lensTold, showExact } from "./exact.js";
import { believing, dropping, locate, locating, showBelief, take, takeAll } from "./model.js";
import { brushed, repainted } from "./painting.js";
import { gamepad, pointers, ring } from "./pointers.js";
import { bookmark, bookmarked, fly, flying, playing } from "./travel.js";
import { watch } from "./work.js";

const STILL_MS = 250, LONGEST_S = 0.1, HASTE = 3, SLOW_MS = 45, QUICK_MS = 22, LEAST_RATIO = 0.3, OUTSIDE_MS = 500;

/** Runs the page; what cannot be is said in it. */
async function begin() {
  theme(localStorage.getItem("naris-theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  if (!document.createElement("canvas").getContext("webgl2")) {
    $("here").textContent = "This browser has no WebGL 2: open the page in a current Firefox, Chrome, Edge or Safari.";
    return;
  }
  const coming = binary("/api/parcel/room"); // takes longest: what can be drawn without it is drawn meanwhile
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
  const pose = bookmarked(start.digest) ?? start.pose;
  sizes({ inside, outside });
  inside.draw(pose, state.fov);
  outside.draw(pose, state.fov, inside.size[0] / inside.size[1]);
  const room = new Room(await coming);
  const flight = new Flight(room, pose);
  const page = { start, surface, about, inside, outside, room, flight, keys: new Keys(), slices: null };
  page.brush = new Brush(surface, geometry, room, {
    drawn: () => state.strokes++,
    changed: (said) => {
      repainted(page, said);
      told(page, flight.pose);
    },
    complain,
  });
  if (start.brush !== null) brushed(page, start.brush);
  if (start.hasSlices) page.slices = new Slices($("slices-canvas"), complain);
  page.strip = new Strip($("strip"), {
    pose: () => flight.pose,
    lens: () => lensTold(page),
    place: start.place,
    back: () => $("inside-canvas").focus(),
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
  sizes(page); // thumbnails are asked for with the lens, which is told by the shape of the view
  await page.strip.load();
  for (const id of ["inside-canvas", "outside-canvas"]) new ResizeObserver(() => sizes(page)).observe($(id));
  onConnection((lost) => ($("lost").hidden = !lost));
  watch(page);
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
  if (moves) ring(page);
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
  const p = flight.position.map((one) => one.toFixed(1)).join(", "), roll = rollOf(pose);
  $("numbers").textContent =
    `${p} mm (${about.frame}) · wall ${room.distance(flight.position).toFixed(1)} mm · ` +
    `inserted ${flight.inserted.toFixed(1)} mm · roll ${roll === null ? "–" : `${Math.round(roll)}°`}`;
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
    takeAll: (files) => takeAll(page, files),
    roll: () => rollOf(page.flight.pose),
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
