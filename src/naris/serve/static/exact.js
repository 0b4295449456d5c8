// The picture by our own renderer, beside that of the page.

import { $, complain, state } from "./ui.js";
import { lensOf } from "./inside.js";
import { askPicture, Latest } from "./talk.js";

const EXACT_PX = 640;

export const drawing = new Latest();

export function exact(page) {
  state.exact = !state.exact;
  $("exact-button").setAttribute("aria-pressed", String(state.exact));
  $("exact").hidden = !state.exact;
  if (state.exact) showExact(page, page.flight.pose);
}

/** What the scope looks through, as the server takes it. */
export function lensTold({ inside }) {
  const [w, h] = inside.size;
  return { fov_deg: state.fov, k1: lensOf(inside.barrel, state.fov, w / h).k1 };
}

export async function showExact(page, pose) {
  const [w, h] = page.inside.size, shrink = Math.min(EXACT_PX / Math.max(w, h), 1);
  const asked = { pose, ...lensTold(page), width: Math.round(w * shrink), height: Math.round(h * shrink), steady: false };
  try {
    const url = URL.createObjectURL(await askPicture("/api/frame", asked, drawing.next()));
    URL.revokeObjectURL($("exact-picture").src);
    $("exact-picture").src = url;
    $("exact").classList.remove("old");
  } catch (error) {
    complain(error);
  }
}
