// Mouse, touch and gamepad.

import { $, state } from "./ui.js";
import { radians } from "./flight.js";
import { lensOf, straightened } from "./inside.js";
import { pinch } from "./touch.js";
import { flyInto, intoRegionOf } from "./travel.js";

const DRAG_RAD_PER_PX = 0.004, PINCH_MM_PER_PX = 0.05, WHEEL_MM = 0.6, WHEEL_PX = 100, DEAD_ZONE = 0.15;

export function pointers(page) {
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
    state.pointer = event;
    ring(page);
    if (!last) return;
    const spread = pinch(fingers);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const by = [event.clientX - last[0], event.clientY - last[1]];
    dragged += Math.abs(by[0]) + Math.abs(by[1]);
    if (painter === event.pointerId) brush.move(wallInside(page, rayOf(page, event)).place);
    else if (fingers.size === 2) flight.move([0, 0, (pinch(fingers) - spread) * PINCH_MM_PER_PX]);
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
  canvas.addEventListener("pointerleave", () => {
    state.pointer = null;
    ring(page);
  });
  canvas.addEventListener("click", (event) => {
    if (dragged >= 4 || brush.isOn) return;
    const { label } = wallInside(page, rayOf(page, event));
    if (label >= 0) flyInto(page, label);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    flight.move([0, 0, (-WHEEL_MM * event.deltaY) / WHEEL_PX]);
  }, { passive: false });
  $("outside-canvas").addEventListener("mousedown", (event) => {
    event.preventDefault(); // a mouse leaves the keys with the scope; Tab gives them to the outside view
    canvas.focus();
  });
  $("outside-canvas").addEventListener("click", (event) => {
    if (outside.dragged >= 4 || brush.isOn) return;
    const met = outside.hit(event);
    if (met) intoRegionOf(page, page.surface.arrays.region[met.corner]);
  });
}

/** A ring about the pointer in the inside view, as wide as the brush is on the wall there; none where no wall is. */
export function ring(page) {
  const { brush, flight } = page, event = state.pointer;
  const met = brush.isOn && event ? wallInside(page, rayOf(page, event)) : null;
  $("ring").hidden = !met?.isWall;
  if (!met?.isWall) return;
  const box = $("inside-canvas").getBoundingClientRect();
  const far = Math.hypot(...met.place.map((one, axis) => one - flight.position[axis]));
  const wide = (brush.radius / Math.max(far, 0.5)) * (box.height / Math.tan(radians(state.fov) / 2));
  Object.assign($("ring").style, {
    left: `${event.clientX - box.left}px`, top: `${event.clientY - box.top}px`, width: `${wide}px`, height: `${wide}px`,
  });
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
export function wallInside(page, ray) {
  const pose = page.flight.pose;
  const length = Math.hypot(...ray);
  const way = [0, 1, 2].map((i) => (pose[i][0] * ray[0] + pose[i][1] * ray[1] + pose[i][2] * ray[2]) / length);
  let label = -1, far = 0, isWall = false;
  for (let k = 0; k < 400; k++) {
    const p = page.flight.position.map((one, axis) => one + far * way[axis]);
    const free = page.room.distance(p);
    const here = page.room.region(p);
    if (here >= 0) label = here;
    isWall = free < 0.15;
    if (isWall) break;
    far += Math.max(free * 0.9, 0.1);
  }
  return { label, isWall: isWall && far > 0, place: page.flight.position.map((one, axis) => one + far * way[axis]) };
}

export function gamepad(wish) {
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
