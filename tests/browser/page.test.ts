// The page against the program itself.

import assert from "node:assert/strict";
import { get } from "node:http";
import { after, before, test } from "node:test";

import type { Browser } from "playwright-core";

import {
  type Server,
  type Watched,
  keep,
  launchBrowser,
  openPage,
  readyCase,
  scratchFolder,
  skip,
  startServer,
} from "./support.ts";

let scratch: Awaited<ReturnType<typeof scratchFolder>>;
let server: Server;
let browser: Browser;
let watched: Watched;

before(
  async () => {
    if (skip) return;
    scratch = await scratchFolder();
    server = await startServer({ command: "demo", data: scratch.folder });
    await readyCase(server.address);
    browser = await launchBrowser();
    watched = await openPage(browser);
    await watched.page.goto(server.address);
  },
  { timeout: 300_000 },
);

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

test("every document forbids what is not its own, and no script or style is inline", { skip }, async () => {
  for (const path of ["/", "/docs"]) {
    const answer = await fetch(new URL(path, server.address));
    const policy = answer.headers.get("content-security-policy") ?? "";
    assert.match(policy, /default-src 'none'/, path);
    assert.doesNotMatch(policy, /unsafe|https?:|\*/, path);
  }
  const html = await (await fetch(new URL("/", server.address))).text();
  assert.doesNotMatch(html, /<style|style=|\son\w+=|<script(?![^>]*src=)|https?:\/\//);
});

test("the script is at most 45 kB on its way", { skip }, async () => {
  const size = await new Promise<number>((resolve, reject) => {
    get(new URL("/main.js", server.address), { headers: { "accept-encoding": "gzip" } }, (answer) => {
      let bytes = 0;
      answer.on("data", (piece: Buffer) => (bytes += piece.length));
      answer.on("end", () =>
        answer.headers["content-encoding"] === "gzip" ? resolve(bytes) : reject(new Error("not gzipped")),
      );
    }).on("error", reject);
  });
  console.log(`main.js: ${size} bytes gzipped`);
  assert.ok(size > 1000 && size <= 45_000, String(size));
});

test("the manual of the interface breaks no policy either", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser);
  await page.goto(new URL("/docs", server.address).href);
  assert.match(await page.locator("body").innerText(), /v1\/cases/);
  assert.deepEqual(troubles, []);
  await context.close();
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(watched.troubles, []);
});
