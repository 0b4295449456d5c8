// Talking to the server: one place that knows of lost connections and of answers that are refusals.

/** A sentence of the server that says why something was not done. */
export class Refused extends Error {}

const RETRY_MS = 1000;
let lost = false;
const listeners = [];

/** Calls back with whether the connection is lost, whenever that changes. */
export function onConnection(listener) {
  listeners.push(listener);
}

function tell(isLost) {
  if (isLost === lost) return;
  lost = isLost;
  for (const listener of listeners) listener(lost);
}

async function once(path, options) {
  const answer = await fetch(path, { credentials: "same-origin", ...options });
  tell(false);
  if (answer.ok) return answer;
  let why = `the server answered ${answer.status}`;
  try {
    const told = await answer.json();
    if (typeof told.error === "string") why = told.error;
  } catch {
    // A refusal that is no JSON is told by its number.
  }
  throw new Refused(why);
}

/** A request that is repeated until there is a connection: nothing that was asked for is lost with one. */
export async function ask(path, options = {}) {
  for (;;) {
    try {
      return await once(path, options);
    } catch (error) {
      if (error instanceof Refused || error.name === "AbortError") throw error;
      tell(true);
      await new Promise((done) => setTimeout(done, RETRY_MS));
    }
  }
}

export async function askJson(path, method = "GET", body = undefined) {
  const options = { method };
  if (body !== undefined) {
    options.headers = { "content-type": "application/json" };
    options.body = JSON.stringify(body);
  }
  return (await ask(path, options)).json();
}
