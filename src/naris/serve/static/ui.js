// What all of the page shares: its elements, its state, and what is said at its top.

import { Refused } from "./talk.js";

const SAY_MS = 6000, OFFER_MS = 20000;

export const $ = (id) => document.getElementById(id);

export const state = {
  fov: 70, playing: null, flying: null, exact: false, stillSince: 0, wasTold: false, lastDraw: 0, drawn: 0, marks: 0,
  view: "", beside: "", look: 0, strokes: 0, strokesDrawn: 0, ratio: 1, isRough: false, paused: false, keyframes: [], dropped: false,
  keepUntil: 0, outsideAt: 0, pointer: null,
};

/** A sentence at the top for a while; `offer` has the label of a button beside it, and what that does. */
export function say(text, isWrong = false, offer = null) {
  $("message").replaceChildren(text);
  if (offer) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: offer.label });
    button.addEventListener("click", () => {
      $("message").hidden = true;
      offer.press();
    });
    $("message").append(" ", button);
  }
  $("message").className = isWrong ? "wrong" : "";
  $("message").hidden = false;
  clearTimeout(state.saying);
  state.saying = setTimeout(() => ($("message").hidden = true), offer ? OFFER_MS : SAY_MS);
}

export function complain(error) {
  if (error.name === "AbortError") return; // another question took its place
  if (!(error instanceof Refused)) throw error;
  say(error.message, true);
}
