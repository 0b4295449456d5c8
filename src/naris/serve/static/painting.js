// The buttons about painting regions, and what follows when they are others.

import { $, complain, say } from "./desk.js";
import { listPlaces } from "./travel.js";

const PAINT_TINT = 50;

export function painting(page) {
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
export function repainted(page, said) {
  page.about.places.splice(0, Infinity, ...said.places);
  listPlaces(page);
  brushed(page, said.undoable);
  if (said.changed === 0) say("nothing there was painted: it has that region, or no air is near", true);
}

export function brushed(page, strokes) {
  page.brush.strokes = strokes;
  $("brush-undo").disabled = strokes === 0;
  $("brush-save").disabled = false;
}

export async function saveRegions(page) {
  try {
    const file = await page.brush.save();
    say(`${file}, beside the keyframes: give it as --regions`);
  } catch (error) {
    complain(error);
  }
}
