// What the server writes: keyframes to take away, and pictures along them.

import { $, complain } from "./ui.js";
import { lensTold } from "./exact.js";
import { ask, askJson, Refused } from "./talk.js";

const WATCH_MS = 2000, KEEP_MS = 6000;
const ELSEWHERE = "another anatomy, or another file of keyframes, is at this address now: load the page again; what is not saved is kept";

export async function exported(page, kind, name) {
  try {
    await page.strip.saved();
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await ask(`/api/keyframes/export/${kind}?${new URLSearchParams(lensTold(page))}`));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), KEEP_MS);
  } catch (error) {
    complain(error);
  }
}

export async function simulate(page) {
  try {
    await page.strip.saved();
    const per_position = Math.min(Math.max(Math.round(Number($("per-position").value)) || 10, 1), 1000);
    showWork(await askJson("/api/simulate", "POST", { per_position, step_mm: 1, ...lensTold(page) }));
  } catch (error) {
    complain(error);
  }
}

export async function stopSimulating() {
  try {
    showWork(await askJson("/api/simulate/stop", "POST", {}));
  } catch (error) {
    complain(error);
  }
}

/** Asks how far the pictures are, again and again; that is also how a lost connection is noticed. */
export async function watch(page) {
  for (let work = {}, wrong = ""; ; ) {
    try {
      work = await askJson("/api/simulate");
      if (work.place !== page.start.place) throw new Refused(ELSEWHERE);
      wrong = "";
      showWork(work);
      page.strip.retry();
    } catch (error) {
      if (error.message !== wrong) complain(error); // once, and not again and again
      wrong = error.message;
    }
    await new Promise((done) => setTimeout(done, work.running ? WATCH_MS / 4 : WATCH_MS));
  }
}

function showWork(work) {
  if (!work.running && document.activeElement === $("simulate-stop")) $("inside-canvas").focus();
  $("progress").hidden = !work.running;
  $("simulate").disabled = work.running;
  $("simulate-stop").hidden = !work.running;
  if (work.total) {
    $("progress").max = work.total;
    $("progress").value = work.done;
  } else {
    $("progress").removeAttribute("value");
  }
  $("simulated").textContent = work.running ? `${work.done} of ${work.total || "…"} pictures` : work.said;
}
