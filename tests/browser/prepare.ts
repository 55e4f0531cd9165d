// Prepares the demo's head with its maps in a folder, for ISOCORTEX_PREPARED_DEMO: `node prepare.mjs FOLDER`.

import assert from "node:assert/strict";

import { readyCase, startServer, until } from "./support.ts";

const [data] = process.argv.slice(2);
assert.ok(data, "name the folder");
const server = await startServer({ command: "demo", data });
try {
  const address = new URL(`v1/cases/${await readyCase(server.address)}`, server.address);
  const { maps } = await until(
    async () => (await (await fetch(address)).json()) as { readonly maps: { readonly state: string } },
    (now) => now.maps.state !== "making",
    480,
  );
  assert.notEqual(maps.state, "making");
} finally {
  await server.stop();
}
