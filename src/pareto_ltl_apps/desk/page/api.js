// Requests to the server of this page; the browser adds the cookie of its session.

/** What the server answers; an Error with its text if it refuses. */
export async function ask(method, path, body = undefined, signal = undefined) {
  const json = body !== undefined && !(body instanceof Blob);
  const answer = await answered(path, {
    method, signal, headers: json ? { "Content-Type": "application/json" } : {}, body: json ? JSON.stringify(body) : body, keepalive: method === "PUT" && JSON.stringify(body).length < 60000,
  });
  return answer.json();
}

async function answered(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("the server does not answer: start pareto-ltl serve again, and open the address that it prints");
  }
  if (answer.ok) return answer;
  const said = await answer.json().catch(() => ({}));
  throw Object.assign(new Error(said.error ?? `the server answered ${answer.status}`), { status: answer.status });
}

/** Call `heard` for each event of a plan until it ends. */
export async function follow(id, heard, signal) {
  const answer = await answered(`/api/plans/${id}/events`, { signal });
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const parts = text.split("\n\n");
    text = parts.pop();
    for (const part of parts) {
      const line = part.split("\n").find(one => one.startsWith("data: "));
      if (line) heard(JSON.parse(line.slice(6)));
    }
  }
}

/** Give a file to the browser. */
export function giveFile(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

/** Fetch a file of the server and give it to the browser. */
export async function download(path) {
  const answer = await answered(path, {});
  const name = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? "plan";
  giveFile(name, await answer.blob());
}
