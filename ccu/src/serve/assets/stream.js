// The stream of server-sent events, read with fetch: an EventSource could not send the token.

const KEY = "supersigma.token";

/** Takes a token out of the address, where neither servers nor histories shall find it. */
export function takeToken() {
  const found = /^#token=([\w.~-]+)$/.exec(location.hash);
  if (!found) return;
  keepToken(found[1]);
  history.replaceState(null, "", location.pathname + location.search);
}

/** Keeps the token for this tab. */
export function keepToken(token) {
  sessionStorage.setItem(KEY, token);
}

/** The headers that show the token, if there is one. */
export function authorization() {
  const token = sessionStorage.getItem(KEY);
  return token ? { Authorization: `Bearer ${token}` } : {};
}

/** What an answer complains of. */
export async function complaint(response) {
  try {
    return (await response.json()).error;
  } catch {
    return { code: "unknown", message: `the server answers ${response.status}`, help: null };
  }
}

/** The events of a response, as `{ name, data }`. */
export async function* events(response) {
  let rest = "";
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const blocks = (rest + value).split("\n\n");
    rest = blocks.pop();
    for (const block of blocks) {
      const found = /^event: (\w+)\ndata: (.*)$/.exec(block);
      if (found) yield { name: found[1], data: JSON.parse(found[2]) };
    }
  }
}
