// What a model says: of what the scope sees, and of a picture or video that is dropped.

import { $, complain, say, state } from "./ui.js";
import { button } from "./strip.js";
import { Latest, Refused, sendFile } from "./talk.js";
import { fly, FLY_MS } from "./travel.js";
import { VIDEO } from "./video.js";

const SHOWN_MS = 250; // after it was flown to, what is said of a picture stays so long

export const believing = new Latest(), locating = new Latest();

export function showBelief(page, said) {
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

export function dropping(page) {
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    takeAll(page, [...event.dataTransfer.files]);
  });
}

/** One after the other, 9 before 10: keyframes keep the order of their names. */
export async function takeAll(page, files) {
  files.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
  let added = 0, outside = 0;
  const refused = [];
  for (const file of files) {
    const keyframes = await take(page, file, (error) => refused.push(`${file.name}: ${error.message}`));
    added += keyframes.length;
    outside += keyframes.filter(({ pose }) => page.room.distance(pose.slice(0, 3).map((row) => row[3])) < 0).length;
  }
  if (refused.length > 1 || (refused.length && added)) {
    return say(`${added} ${added === 1 ? "keyframe" : "keyframes"} taken in; refused: ${refused.join("; ")}`, true);
  }
  if (refused.length) return say(refused[0], true);
  if (!added) return;
  const from = files.length === 1 ? files[0].name : `${files.length} files`;
  const told = `${added} ${added === 1 ? "keyframe" : "keyframes"} from ${from}`;
  say(outside ? `${told}; ${outside} of them ${outside === 1 ? "is" : "are"} not in the air: are frame and unit right?` : told, outside > 0);
}

/** A file that was dropped or chosen: keyframes, which it gives, or a picture or video for the model to locate. */
export async function take(page, file, refused = complain) {
  try {
    if (/\.(json|txt|zip)$/i.test(file.name)) {
      const { keyframes } = await sendFile(`/api/keyframes/import?name=${encodeURIComponent(file.name)}`, file);
      page.strip.add(keyframes);
      return keyframes;
    }
    if (!page.start.hasModel) say("expected a model to locate with, got none: start naris steer with --model", true);
    else if (file.type.startsWith("video/") || VIDEO.test(file.name)) page.video.open(file);
    else await locate(page, file, file.name);
  } catch (error) {
    if (error instanceof Refused) refused(error);
    else complain(error);
  }
  return [];
}

/** Where the model believes that a picture is from: told, shown, and flown to. */
export async function locate(page, picture, name) {
  const said = await sendFile("/api/locate", picture, locating.next());
  state.dropped = true; // what is said of a picture stays until one moves on
  state.keepUntil = performance.now() + FLY_MS + SHOWN_MS;
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
