// What all of the page shares: its elements, its state, and what is said at its top.

import { Refused } from "./talk.js";

const SAY_MS = 6000;

export const $ = (id) => document.getElementById(id);

export const state = {
  fov: 70, playing: null, flying: null, exact: false, stillSince: 0, wasTold: false, lastDraw: 0, drawn: 0, marks: 0,
  view: "", beside: "", look: 0, strokes: 0, strokesDrawn: 0, ratio: 1, isRough: false, paused: false, keyframes: [], dropped: false,
  keepUntil: 0, outsideAt: 0,
};

export function say(text, isWrong = false) {
  $("message").textContent = text;
  $("message").className = isWrong ? "wrong" : "";
  $("message").hidden = false;
  clearTimeout(state.saying);
  state.saying = setTimeout(() => ($("message").hidden = true), SAY_MS);
}

export function complain(error) {
  if (error.name === "AbortError") return; // another question took its place
  if (!(error instanceof Refused)) throw error;
  say(error.message, true);
}
