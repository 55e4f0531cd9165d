// Cases and layers that tests send to a server without the page.

import assert from "node:assert/strict";

import { type Server, until } from "./support.ts";

type Part = Buffer | string;
/** The parts of a form by name; of several files, each is a part of that name. */
type Parts = Readonly<Record<string, Part | readonly Part[]>>;
type Headers = Readonly<Record<string, string>>;

/** Sends a form, waits until what it made is ready, and returns its id. */
async function send(server: Server, path: string, parts: Parts, headers: Headers): Promise<string> {
  const form = new FormData();
  for (const [name, part] of Object.entries(parts))
    for (const one of [part].flat())
      form.append(name, new Blob([typeof one === "string" ? one : new Uint8Array(one)]), name);
  const address = new URL(path, server.address);
  const sent = await fetch(address, { method: "POST", body: form, headers });
  const { id } = (await sent.json()) as { id: string };
  const made = await until(
    async () => (await (await fetch(`${address.href}/${id}`, { headers })).json()) as { state: string },
    ({ state }) => /ready|failed/.test(state),
  );
  assert.equal(made.state, "ready", JSON.stringify(made));
  return id;
}

/** Sends a case and waits until it is ready. */
export const sendCase = (server: Server, parts: Parts, headers: Headers = {}): Promise<string> =>
  send(server, "v1/cases", parts, headers);

/** Adds a layer that lies where its header says, and waits until it is ready. */
export const sendLayer = (
  server: Server,
  id: string,
  about: { readonly name: string; readonly kind: string },
  volume: Buffer,
): Promise<string> => {
  const parameters = JSON.stringify({ ...about, transform: "none" });
  return send(server, `v1/cases/${id}/layers`, { parameters, volume }, {});
};
