// Two cases side by side: two frames with the page, linked by the registration of their heads.

import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";

import type { Browser, Frame, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { isBrain, nifti } from "./phantom.ts";
import { type Server, type Stage, keep, openPage, shown, skip, startStage, until } from "./support.ts";
import { sendCase } from "./uploads.ts";

const TOKEN = "a-token-of-more-than-sixteen-letters";
/** How far the second head lies to the right of the first, in mm. */
const MOVED_MM = 8;

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let first: string;
let later: string;

const bearer = { authorization: `Bearer ${TOKEN}` };

/** A head with a pattern that repeats nowhere, at a place along the axis to the patient's right, brighter by a factor. */
const head = (right_mm: number, brightness: number): Buffer =>
  nifti((x, y, z) => {
    const [a, b, c] = [x - right_mm, y, z];
    const pattern = Math.sin(a / 7) * Math.cos(b / 9 + a / 31) + Math.sin(c / 6 + b / 23) * Math.cos(a / 11);
    return isBrain(a, b, c) ? Math.round(brightness * (500 + 200 * pattern)) : 0;
  });
const mask = (right_mm: number): Buffer => nifti((x, y, z) => (isBrain(x - right_mm, y, z) ? 1 : 0));

const prepared = (name: string, right_mm: number, brightness: number): Promise<string> => {
  const parameters = JSON.stringify({ name });
  return sendCase(server, { volume: head(right_mm, brightness), mask: mask(right_mm), parameters }, bearer);
};

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve", async (folder) => {
      const file = path.join(folder, "token");
      await writeFile(file, TOKEN, { mode: 0o600 });
      return ["--token-file", file];
    });
    ({ server, browser } = stage);
    first = await prepared("First scan", 0, 1);
    later = await prepared("Later scan", MOVED_MM, 2);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

const frames = (page: Page): [Frame, Frame] => {
  const [, left, right] = page.frames();
  assert.ok(left && right, `${page.frames().length} frames`);
  return [left, right];
};

/** What the address of a frame says under a key, once it is as wanted. */
const said = (frame: Frame, key: string, isGood: (text: string) => boolean): Promise<string> =>
  until(() => frame.evaluate((name) => new URLSearchParams(location.hash.slice(1)).get(name) ?? "", key), isGood);

const numbers = (text: string): number[] => text.split(",").map(Number);

async function typeToken(page: Page): Promise<void> {
  await page.locator("#token").fill(TOKEN);
  await page.keyboard.press("Enter");
}

test("the page leads to two cases, which are linked in angle, depth, point and window", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser);
  await page.goto(new URL(`#${first}&d=12`, server.address).href);
  await typeToken(page);
  await shown(page);
  await page.locator(".bar > a[href=compare]").click();
  // The token was handed on: nobody is asked a second time, neither here nor in the frames.
  let release = (): void => {};
  const held = new Promise<void>((resolve) => (release = resolve));
  await page.route(`**/v1/cases/${later}`, async (route) => {
    await held;
    await route.continue();
  });
  await page.locator("#compare-right").selectOption(later);
  const note = page.locator(".side-note");
  await note.last().waitFor();
  assert.equal(await note.last().innerText(), "Opening the case …");
  release();
  await page.waitForSelector("body[data-linked=true]");
  assert.equal(await note.count(), 0);
  assert.match(await page.locator(".verdict").innerText(), /^Same head, registered: 8\.\d mm, 0\.\d°$/);
  assert.deepEqual(await page.evaluate(() => ({ ...sessionStorage })), {});
  const [left, right] = frames(page);
  assert.equal(await left.locator("#case-title").innerText(), "First scan");
  assert.equal(await right.locator("#case-title").innerText(), "Later scan");
  assert.equal(await said(right, "d", (text) => text === "12"), "12");

  await left.locator("#depth-number").fill("16");
  await page.keyboard.press("Enter");
  assert.equal(await said(right, "d", (text) => text === "16"), "16");
  // What is done on the right side is done on the left side, too.
  await right.locator("#surface").press("Shift+S");
  const top = (frame: Frame): Promise<string> => frame.locator("#surface .edge.top").first().innerText();
  assert.equal(
    await until(
      () => top(right),
      (letter) => letter === "A",
    ),
    "A",
  );
  assert.equal(
    await until(
      () => top(left),
      (letter) => letter === "A",
    ),
    "A",
  );

  // A point marked in one is marked at the same place of the other head.
  await left.locator("#surface").press("Enter");
  const own = numbers(await said(left, "x", (text) => text !== ""));
  const its = numbers(await said(right, "x", (text) => text !== ""));
  const apart = own.map((part, axis) => (its[axis] ?? NaN) - part);
  // LPS: to the right is less.
  [-MOVED_MM, 0, 0].forEach((wanted, axis) => assert.ok(Math.abs((apart[axis] ?? NaN) - wanted) < 0.8, String(apart)));

  // Windows follow in shares of the own one: the later scan is twice as bright.
  await left.locator("#surface").press("3");
  const [narrow, wide] = [await said(left, "w", (text) => text !== ""), await said(right, "w", (text) => text !== "")];
  const ratio = (numbers(wide)[1] ?? NaN) / (numbers(narrow)[1] ?? NaN);
  assert.ok(Math.abs(ratio - 2) < 0.1, `${narrow} ${wide}`);
  await keep(page, "compare");
  const state = await until(
    () => page.evaluate(() => location.hash),
    (hash) => hash.includes(`/${later}`) && hash.includes("d=16"),
  );
  assert.ok(state.startsWith(`#${first}&`), state);

  // Unlinked, each goes its own way.
  await page.locator("#linked").uncheck();
  await left.locator("#depth-number").fill("9");
  await page.keyboard.press("Enter");
  assert.equal(await said(left, "d", (text) => text === "9"), "9");
  assert.equal(await said(right, "d", () => true), "16");
  await page.locator("#linked").check();
  assert.equal(await said(right, "d", (text) => text === "9"), "9");
  // What can be chosen follows the server's list.
  const change = { method: "PATCH", body: '{"name":"Renamed scan"}', headers: { authorization: `Bearer ${TOKEN}` } };
  await fetch(new URL(`v1/cases/${later}`, server.address), change);
  const offered = (): Promise<string[]> => page.locator("#compare-left option").allInnerTexts();
  const names = await until(offered, (now) => now.some((one) => one.startsWith("Renamed scan")), 30);
  assert.ok(
    names.some((one) => one.startsWith("Renamed scan")),
    names.join(),
  );
  assert.equal(await page.locator("#compare-right").inputValue(), later, "what was chosen stays");
  // The token was asked for: the browser says so.
  assert.ok(
    troubles.every((trouble) => trouble.includes("401")),
    troubles.join("\n"),
  );
  await context.close();
});

test("an address opens both cases as they were; one that names none opens none", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await page.goto(new URL(`compare#${first}&d=7/${later}&d=7&l=slices`, server.address).href);
  await typeToken(page);
  await page.waitForSelector("body[data-linked=true]");
  const [left, right] = frames(page);
  assert.equal(await said(left, "d", (text) => text === "7"), "7");
  await keep(page, "compare-again");
  assert.deepEqual(await violations(page), []);
  // The right one takes over what the left one shows.
  assert.equal(await said(right, "l", (text) => text === ""), "");
  for (const [asked, words] of [
    ["nonsense", "Choose two cases."],
    [`${"0".repeat(32)}/${later}`, "There is no case with this id."],
  ] as const) {
    await page.goto(new URL(`compare#${asked}`, server.address).href);
    await page.reload();
    await typeToken(page);
    const verdict = (): Promise<string> => page.locator(".verdict").innerText();
    assert.equal(await until(verdict, (said) => said === words, 30), words);
  }
  // The token was asked for: the browser says so.
  assert.ok(
    troubles.every((trouble) => /401|404/.test(trouble)),
    troubles.join("\n"),
  );
  await context.close();
});
