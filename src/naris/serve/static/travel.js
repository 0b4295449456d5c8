// Going somewhere: to a place, along the keyframes, to what a bookmark says.

import { $, complain, say, state } from "./ui.js";
import { between } from "./flight.js";
import { askJson } from "./talk.js";

const PLAY_MM_S = 8;
export const FLY_MS = 350;

/** To a pose, so that one sees the way; straight through whatever lies between. */
export function fly(page, pose) {
  page.flight.remember();
  state.playing = null;
  state.flying = { from: page.flight.pose, to: pose, begun: null };
}

export function flying(page, now) {
  const way = state.flying;
  way.begun ??= now;
  const t = Math.min((now - way.begun) / FLY_MS, 1);
  page.flight.setPose(between(way.from, way.to, t * t * (3 - 2 * t)));
  if (t === 1) {
    state.flying = null;
    page.flight.inserted = 0;
  }
}

export async function play(page) {
  if (state.playing) return (state.playing = null);
  if (state.keyframes.length < 2) return say("two keyframes make a trajectory: save another viewpoint", true);
  try {
    await page.strip.saved();
    const { poses } = await askJson("/api/trajectory?step_mm=1");
    page.flight.remember();
    state.playing = { poses, at: 0 };
  } catch (error) {
    complain(error);
  }
}

export function playing(page, seconds) {
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

export function bookmark(digest, pose) {
  const numbers = pose.slice(0, 3).flat().map((one) => Number(one.toFixed(5)));
  return `#in=${digest.slice(0, 12)}&pose=${numbers.join(",")}`;
}

/** The pose in the address, if it is of this anatomy. */
export function bookmarked(digest) {
  const told = new URLSearchParams(location.hash.slice(1));
  const numbers = (told.get("pose") ?? "").split(",").map(Number);
  if (numbers.length !== 12 || !numbers.every(Number.isFinite)) return null;
  if (told.get("in") !== digest.slice(0, 12)) {
    say("the bookmark is of another anatomy: here is the start of this one", true);
    return null;
  }
  return [numbers.slice(0, 4), numbers.slice(4, 8), numbers.slice(8, 12), [0, 0, 0, 1]];
}

export function flyInto(page, number) {
  const name = page.about.regions[number]?.name;
  const place = page.about.places.find((one) => one.kind === "region" && one.name === name);
  if (place) fly(page, place.pose);
  else say(name === undefined ? "there is no region" : `no passage leads into ${name}`, true);
}

export function intoRegionOf(page, label) {
  if (label < page.about.regions.length) flyInto(page, label);
  else say("that wall is of no region", true);
}

export function listPlaces(page) {
  const all = [{ name: "the start" }, ...page.about.places];
  $("places").replaceChildren(...all.map(({ name, kind }, k) => new Option(kind === "region" ? `${name} (region)` : name, k)));
}
