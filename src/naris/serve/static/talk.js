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

async function once(path, options, read) {
  const answer = await fetch(path, { credentials: "same-origin", ...options });
  if (answer.ok) {
    const data = await read(answer);
    tell(false);
    return data;
  }
  tell(false);
  if (answer.status === 403) {
    throw new Refused("the server was started anew: open the address that it printed; keyframes are kept until then");
  }
  let why = `the server answered ${answer.status}`;
  try {
    const told = await answer.json();
    if (typeof told.error === "string") why = told.error;
  } catch {
    // A refusal that is no JSON is told by its number.
  }
  throw new Refused(why);
}

/** A request that is repeated until it is answered to the end: nothing that was asked for is lost with a connection. */
export async function ask(path, options = {}, read = (answer) => answer.blob()) {
  for (;;) {
    try {
      return await once(path, options, read);
    } catch (error) {
      if (error instanceof Refused || error.name === "AbortError") throw error;
      tell(true);
      await new Promise((done) => setTimeout(done, RETRY_MS));
    }
  }
}

const JSON_OF = (answer) => answer.json();

export async function askJson(path, method = "GET", body = undefined, signal = undefined) {
  const options = { method, signal };
  if (body !== undefined) {
    options.headers = { "content-type": "application/json" };
    options.body = JSON.stringify(body);
  }
  return ask(path, options, JSON_OF);
}

/** What a file comes to, sent as it is. */
export async function sendFile(path, file, signal = undefined) {
  return ask(path, { method: "POST", body: file, signal }, JSON_OF);
}

/** A picture that the server makes, by what is asked of it. */
export async function askPicture(path, body, signal = undefined) {
  const headers = { "content-type": "application/json" };
  return ask(path, { method: "POST", headers, body: JSON.stringify(body), signal });
}

/** Requests of which only the last one counts: a new one ends those before it. */
export class Latest {
  next() {
    this.controller?.abort();
    this.controller = new AbortController();
    return this.controller.signal;
  }

  end() {
    this.controller?.abort();
  }
}
