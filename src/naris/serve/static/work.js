// What the server writes: keyframes to take away, and pictures along them.

import { $, complain } from "./desk.js";
import { lensTold } from "./exact.js";
import { ask, askJson } from "./talk.js";

const WATCH_MS = 2000, KEEP_MS = 6000;

export async function exported(page, kind, name) {
  try {
    await page.strip.saving;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await ask(`/api/keyframes/export/${kind}`));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), KEEP_MS);
  } catch (error) {
    complain(error);
  }
}

export async function simulate(page) {
  try {
    await page.strip.saving;
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
  for (let work = {}; ; ) {
    try {
      work = await askJson("/api/simulate");
      showWork(work);
      page.strip.retry();
    } catch (error) {
      complain(error);
    }
    await new Promise((done) => setTimeout(done, work.running ? WATCH_MS / 4 : WATCH_MS));
  }
}

function showWork(work) {
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
