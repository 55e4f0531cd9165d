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
  { timeout: 600_000 },
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

/** The bytes of a file of the page on its way. */
const sizeOf = (address: string): Promise<number> =>
  new Promise((resolve, reject) => {
    get(address, { headers: { "accept-encoding": "gzip" } }, (answer) => {
      let bytes = 0;
      answer.on("data", (piece: Buffer) => (bytes += piece.length));
      answer.on("end", () =>
        answer.headers["content-encoding"] === "gzip" ? resolve(bytes) : reject(new Error(`${address}: not gzipped`)),
      );
    }).on("error", reject);
  });

// The files of ISOCORTEX_PAGE are not on their way from the program.
const of_program = skip || (process.env.ISOCORTEX_PAGE ? "the page is not sent by the program" : false);
test(
  "the first scripts are at most 45 kB on their way; the others, fetched on demand, make it 60 kB",
  { skip: of_program },
  async () => {
    const { page, context } = await openPage(browser);
    const asked = new Set<string>();
    page.on("request", (request) => {
      if (new URL(request.url()).pathname.endsWith(".js")) asked.add(request.url());
    });
    const total = async (): Promise<number> =>
      (await Promise.all([...asked].map(sizeOf))).reduce((sum, size) => sum + size, 0);
    await page.goto(new URL("/#nothing", server.address).href);
    await page.waitForSelector("body[data-loaded=true]");
    const first = await total();
    await page.locator(".bar .icon-button").last().click();
    await page.waitForSelector("dialog.help");
    const all = await total();
    console.log(`scripts, gzipped: ${first} bytes at first, ${all} with all that is fetched on demand`);
    assert.ok(first > 1000 && first <= 45_000, String(first));
    assert.ok(all > first && all <= 60_000, String(all));
    await context.close();
  },
);

test("the page for two cases has a script of its own, of at most 6 kB on its way", { skip: of_program }, async () => {
  const size = await sizeOf(new URL("/compare.js", server.address).href);
  assert.ok(size > 1000 && size <= 6000, String(size));
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
