// The buttons about painting regions, and what follows when they are others.

import { $, complain, say } from "./ui.js";
import { listPlaces } from "./travel.js";

const PAINT_TINT = 50;
let tintBefore = null;

export function painting(page) {
  const { brush, outside } = page;
  if (!page.about.regions.length) return say("this anatomy has no regions to paint: start naris steer with --regions slabs", true);
  brush.isOn = !brush.isOn;
  if (!brush.isOn) brush.end();
  outside.brush = brush.isOn ? brush : null;
  $("brush").setAttribute("aria-pressed", String(brush.isOn));
  $("brush-controls").hidden = !brush.isOn;
  $("ring").hidden = true;
  if (brush.isOn) {
    const tint = Number($("tint").value);
    tintBefore = tint < PAINT_TINT ? tint : null;
    if (tintBefore !== null) setTint(PAINT_TINT); // one must see what one paints
  } else if (tintBefore !== null && Number($("tint").value) === PAINT_TINT) setTint(tintBefore);
}

function setTint(percent) {
  $("tint").value = String(percent);
  $("tint").dispatchEvent(new Event("input"));
}

/** The regions are others: where they are entered, and what is drawn, too. */
export function repainted(page, said) {
  page.about.places.splice(0, Infinity, ...said.places);
  listPlaces(page);
  brushed(page, said);
  if (said.changed === 0) say("nothing there was painted: it has that region, or no air is near", true);
}

/** What the server says of the brush: strokes that can be taken back, and whether all of it is in a file. */
export function brushed(page, { undoable: strokes, saved: isSaved }) {
  page.brush.strokes = strokes;
  $("brush-undo").disabled = strokes === 0;
  $("brush-save").disabled = isSaved;
}

export async function saveRegions(page) {
  try {
    const said = await page.brush.save();
    brushed(page, said);
    say(`${said.file}, beside the keyframes: give it as --regions`);
  } catch (error) {
    complain(error);
  }
}
