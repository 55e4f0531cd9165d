// The page against the program itself.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser } from "playwright-core";

import { type Server, type Stage, type Watched, keep, openPage, readyCase, skip, startStage } from "./support.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let watched: Watched;

before(
  async () => {
    if (skip) return;
    stage = await startStage("demo");
    ({ server, browser } = stage);
    await readyCase(server.address);
    watched = await openPage(browser);
    await watched.page.goto(server.address);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

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

test("the page is fetched at once, and in one language", { skip }, async () => {
  const { page, context } = await openPage(browser);
  const asked: string[] = [];
  page.on("request", (request) => asked.push(new URL(request.url()).pathname));
  const scripts = (): readonly string[] => asked.filter((path) => path.endsWith(".js"));
  await page.goto(new URL("/#nothing", server.address).href);
  await page.waitForSelector("body[data-loaded=true]");
  const isAsked = (name: string): boolean => scripts().some((path) => path.startsWith(`/${name}-`));
  assert.deepEqual(["main", "words.en", "words.pt-BR"].filter(isAsked), ["main", "words.en"]);
  const { length } = scripts();
  await page.locator(".bar .icon-button").last().click();
  await page.waitForSelector("dialog.help");
  assert.equal(scripts().length, length, "nothing more is fetched for the help");
  await context.close();
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
