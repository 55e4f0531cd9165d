// The page against the program itself.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser } from "playwright-core";

import { type Server, type Watched, keep, launchBrowser, openPage, readyCase, scratchFolder, skip, startServer } from "./support.ts";

let scratch: Awaited<ReturnType<typeof scratchFolder>>;
let server: Server;
let browser: Browser;
let watched: Watched;

before(async () => {
  if (skip) return;
  scratch = await scratchFolder();
  server = await startServer({ command: "demo", data: scratch.folder });
  await readyCase(server.address);
  browser = await launchBrowser();
  watched = await openPage(browser);
  await watched.page.goto(server.address);
}, { timeout: 300_000 });

after(async () => {
  await browser?.close();
  await server?.stop();
  await scratch?.clean();
});

test("the page lists the demo's case and shows it", { skip }, async () => {
  const { page } = watched;
  await page.waitForSelector("#case-list [data-state=ready]");
  await page.waitForFunction(() => document.querySelector<HTMLElement>("#surface")?.dataset.drawn === "true");
  await keep(page, "desktop");
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(watched.troubles, []);
});
