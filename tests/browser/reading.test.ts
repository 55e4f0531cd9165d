// The frame of a reading: the tabs of the panel, what was looked at, and layouts that a reader has saved.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import {
  type Server,
  type Stage,
  brightest,
  fragment,
  keep,
  openPage,
  shown,
  skip,
  startStage,
  typeDepth,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

const titles = (page: Page): Promise<string[]> => page.locator(".panel > .group:visible > summary").allInnerTexts();

test("pictures have most of the page, and the panel has three tabs", { skip, timeout: 300_000 }, async () => {
  const none = { cookies: [], origins: [] };
  const { page, context, troubles } = await openPage(browser, { storageState: none });
  await page.goto(new URL(`#${id}&r=mesh`, server.address).href);
  await shown(page);
  const read = [
    "Places and findings",
    "Conclusion and signature",
    "Point and depth profile",
    "Looked at",
    "Saved layouts",
    "View",
  ];
  assert.deepEqual(await titles(page), read);
  // Once the first remark has been read; the phantom has a warning, too.
  await page.locator(".first-time button").click();
  await page.evaluate(() => document.querySelector(".quality")?.setAttribute("hidden", ""));
  const panes = await page.locator(".panes").boundingBox();
  assert.ok(panes && (panes.width * panes.height) / (1440 * 900) >= 0.7, JSON.stringify(panes));
  assert.deepEqual(await violations(page), []);
  const tasks = page.locator(".tasks");
  await tasks.getByRole("button", { name: "Images" }).press("Enter");
  assert.deepEqual(await titles(page), ["Layers", "Drawing"]);
  // The ruler is where it can be read.
  await page.focus("#surface");
  await page.keyboard.press("k");
  await page.waitForSelector("body[data-tool=length]");
  assert.ok((await titles(page)).includes("Ruler"));
  await page.keyboard.press("Escape");
  await tasks.getByRole("button", { name: "Case" }).click();
  const ofCase = await titles(page);
  assert.ok(ofCase.includes("Case and mask") && !ofCase.includes("Places and findings"), ofCase.join());
  await page.reload();
  await shown(page);
  assert.deepEqual(await titles(page), ofCase);
  // The picture says once what it is not for.
  const notices = page.getByText("For research use only. Not for diagnosis.");
  const seen = await notices.evaluateAll(
    (all) => all.filter((one) => one.checkVisibility({ visibilityProperty: true })).length,
  );
  assert.equal(seen, 1);
  await tasks.getByRole("button", { name: "Read" }).click();
  for (const [width, theme] of [
    [390, "dark"],
    [820, "light"],
    [1440, "light"],
    [1440, "dark"],
  ] as const) {
    await page.setViewportSize({ width, height: 900 });
    await page.reload();
    await shown(page);
    await page.evaluate((name) => (document.documentElement.dataset["theme"] = name), theme);
    await keep(page, `reading-${width}-${theme}`);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px`);
    assert.deepEqual(await violations(page), []);
  }
  assert.deepEqual(troubles, []);
  await context.close();
});

test("what was looked at is counted, by view and depth", { skip, timeout: 300_000 }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await page.goto(new URL(`#${id}&r=mesh&d=8`, server.address).href);
  await shown(page);
  await page.locator("summary", { hasText: "Looked at" }).click();
  const cell = (view: number, band: number): Promise<string> =>
    page.locator(".checklist tbody tr").nth(band).locator("td").nth(view).innerText();
  const looked = await until(
    () => cell(0, 1),
    (words) => /^[2-9]\d* s$/.test(words),
  );
  assert.match(looked, /^\d+ s$/);
  assert.deepEqual([await cell(1, 1), await cell(0, 3)], ["–", "–"]);
  await page.focus("#surface");
  await page.keyboard.press("Shift+R");
  await typeDepth(page, 16);
  assert.match(
    await until(
      () => cell(1, 3),
      (words) => words !== "–",
    ),
    / s$/,
  );
  // It stays in the page.
  assert.doesNotMatch(await page.evaluate(() => JSON.stringify({ ...localStorage })), /right|16/);
  await page.getByRole("button", { name: "Begin again" }).click();
  assert.equal(await cell(0, 1), "–");
  assert.deepEqual(await violations(page), []);
  assert.deepEqual(troubles, []);
  await context.close();
});

test(
  "a layout is saved by name, and brought back by g and its number, also in another window",
  { skip, timeout: 300_000 },
  async () => {
    const { page, context, troubles } = await openPage(browser);
    await page.goto(new URL(`#${id}&d=12&l=both`, server.address).href);
    await shown(page);
    await page.locator("summary", { hasText: "Saved layouts" }).click();
    const name = '\u202e<b onclick="x">mine';
    await page.getByLabel("Name of the layout").fill(name);
    await page.keyboard.press("Enter");
    const saved = page.locator(".saved-layouts li");
    assert.equal(await saved.count(), 1);
    assert.equal(await saved.locator("button").first().innerText(), '<b onclick="x">mine');
    const kept = await page.evaluate(() => localStorage["isocortex-layouts"] as string);
    assert.ok(!kept.includes(id), "nothing of the case");

    await page.locator('.layouts button[value="single"]').click();
    await typeDepth(page, 5);
    await page.focus("#surface");
    // Without g a number is a preset of the window.
    await page.keyboard.press("1");
    assert.equal((await fragment(page)).d, "5");
    await page.keyboard.press("g");
    await page.keyboard.press("1");
    const { d, l } = await until(
      () => fragment(page),
      (now) => now.d === "12",
    );
    assert.deepEqual([d, l], ["12", "both"]);
    await page.keyboard.press("g");
    await page.keyboard.press("9");
    assert.equal(await page.textContent("#live"), "There is no saved layout 9.");
    assert.deepEqual(await violations(page), []);

    const other = await context.newPage();
    await other.goto(new URL(`#${id}`, server.address).href);
    await shown(other);
    await other
      .locator(".saved-layouts li")
      .getByRole("button", { name: /^Remove/ })
      .click();
    await page.waitForFunction(() => document.querySelectorAll(".saved-layouts li").length === 0);
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test(
  "where the pane is higher than wide, the mirrored halves lie one above the other: the right side is below, flipped",
  { skip, timeout: 300_000 },
  async () => {
    const { page, context, troubles } = await openPage(browser, { viewport: { width: 600, height: 1100 } });
    for (const way of ["mesh", "server"]) {
      // Another fragment alone would not load the page anew.
      await page.goto("about:blank");
      await page.goto(new URL(`#${id}&r=${way}&d=12&l=mirror&w=600,400`, server.address).href);
      await shown(page);
      await page.waitForSelector("#surface.stacked");
      const box = await page.locator("#surface").boundingBox();
      assert.ok(box && box.height > box.width, JSON.stringify(box));
      // The bright ball is on the patient's right, in the middle of its half.
      const clip = (top: number) => ({ x: box.x, y: box.y + top, width: box.width, height: box.height / 2 });
      const lit = async (top: number) => brightest(page, await page.screenshot({ clip: clip(top) }), 230);
      const below = await until(
        () => lit(box.height / 2),
        (found) => (found?.count ?? 0) > 500,
      );
      assert.ok(below && Math.abs(below.x - 0.5) < 0.05 && Math.abs(below.y - 0.5) < 0.05, JSON.stringify(below));
      const above = await lit(0);
      assert.ok((above?.count ?? 0) < below.count / 10, JSON.stringify(above));
      await page.mouse.dblclick(box.x + below.x * box.width, box.y + box.height / 2 + below.y * (box.height / 2));
      const { x = "" } = await until(
        () => fragment(page),
        (now) => now.x !== undefined,
      );
      // LPS counts to the left; the marked hemisphere is above now.
      assert.ok(Number(x.split(",")[0]) < -30, x);
      const badge = page.locator("#surface .overlay:not(.other) .badge");
      const side = await until(
        () => badge.innerText(),
        (words) => /^Right/.test(words),
      );
      assert.match(side, /^Right/);
      await keep(page, `stacked-${way}`);
    }
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test(
  "0 goes through the steps of a reading and back, which are ticked; what the case cannot show is passed over, and said",
  { skip, timeout: 300_000 },
  async () => {
    const { page, context, troubles } = await openPage(browser);
    await page.goto(new URL(`#${id}&r=mesh&d=12&v=superior`, server.address).href);
    await shown(page);
    await page.locator("summary", { hasText: "Looked at" }).click();
    const steps = page.locator(".steps button");
    const inner = ["Left", "Right"].map((side) => `${side} · Inner side · 8 mm`);
    const names = ["Left · 8 mm", "Right · 8 mm", ...inner, "Map · 8 mm"];
    assert.deepEqual(await steps.allInnerTexts(), [...names, "Places to look at", "FLAIR", "Findings and report"]);
    const said = (words: string): Promise<void> => page.locator(".note", { hasText: words }).waitFor();
    await page.focus("#surface");
    await page.keyboard.press("0");
    await said("Step 1 of 8: Left · 8 mm");
    const { d, v } = await fragment(page);
    assert.deepEqual([d, v], ["8", undefined]);
    await page.locator(".steps .seen").waitFor();
    await page.keyboard.press("0");
    await said("Step 2 of 8: Right · 8 mm");
    // The bright ball is on the patient's right.
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    const lit = await until(
      async () => brightest(page, await page.screenshot({ clip: box }), 230),
      (found) => (found?.count ?? 0) > 500,
    );
    assert.ok(lit && Math.abs(lit.x - 0.5) < 0.05, JSON.stringify(lit));
    assert.equal((await fragment(page)).v, "right");
    await page.locator(".steps .seen", { hasText: "Right · 8 mm" }).waitFor();
    await page.keyboard.press("Shift+0");
    await said("Step 1 of 8");
    await page.keyboard.press("Shift+0");
    await said("This is the first step.");
    assert.equal((await fragment(page)).v, undefined);

    await steps.filter({ hasText: "Map" }).click();
    await page.waitForSelector("body[data-layout=map]");
    assert.equal(await page.locator(".steps [aria-current=step]").innerText(), "Map · 8 mm");
    const current = page.locator(".steps [aria-current=step]");
    await page.focus("#flat-map");
    await page.keyboard.press("0");
    await current.filter({ hasText: "Places to look at" }).waitFor();
    // Nothing was added to the phantom.
    assert.ok(await steps.filter({ hasText: "FLAIR" }).isDisabled());
    await page.keyboard.press("0");
    await said("This case does not have: FLAIR. Step 8 of 8: Findings and report");
    await page.keyboard.press("0");
    await said("That was the last step.");
    for (const [width, height, theme] of [
      [1440, 900, "dark"],
      [1024, 768, "light"],
    ] as const) {
      await page.setViewportSize({ width, height });
      await page.evaluate((name) => (document.documentElement.dataset["theme"] = name), theme);
      await steps.first().scrollIntoViewIfNeeded();
      await keep(page, `steps-${width}-${theme}`);
      assert.deepEqual(await violations(page), []);
    }
    await page.locator("#protocol").selectOption({ label: "Mirrored" });
    assert.deepEqual((await steps.allInnerTexts()).slice(0, 2), ["Mirror · 8 mm", "Map · 8 mm"]);
    await page.reload();
    await shown(page);
    assert.equal(await steps.count(), 5);
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("the pictures are shown alone, and moved by a drag", { skip, timeout: 300_000 }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await page.goto(new URL(`#${id}&r=mesh&d=12&l=slices`, server.address).href);
  await shown(page);
  await page.focus("#surface");
  await page.keyboard.press("Shift+V");
  await page.waitForSelector("body.alone");
  // Nothing is beside them but what is in doubt, in one line.
  const [panes, doubt] = [await page.locator(".panes").boundingBox(), await page.locator(".quality").boundingBox()];
  assert.ok(panes && doubt && doubt.height < 40, `${doubt?.height}`);
  assert.deepEqual([panes.width, panes.height + doubt.height], [1440, 900]);
  await keep(page, "alone");
  await page.keyboard.press("Escape");
  await page.locator(".depth-bar").waitFor();

  const slice = await page.locator(".slice.axial .slice-view").boundingBox();
  assert.ok(slice);
  const middle = [slice.x + slice.width / 2, slice.y + slice.height / 2] as const;
  const drag = async (): Promise<void> => {
    await page.mouse.move(...middle);
    await page.mouse.down();
    await page.mouse.move(middle[0] + 40, middle[1] + 10, { steps: 4 });
    await page.mouse.up();
  };
  const lit = async (): Promise<number> =>
    (await brightest(page, await page.screenshot({ clip: slice }), 230))?.x ?? NaN;
  const before = await lit();
  assert.ok(before < 0.5, "the ball, on the patient's right, is on the left");
  const move = page.locator(".tools").getByRole("button", { name: /^Move/ });
  await move.click();
  await drag();
  // The head follows the hand.
  await until(
    () => lit(),
    (now) => Math.abs(now - before - 40 / slice.width) < 0.01,
  );
  assert.equal((await fragment(page)).x, undefined, "nothing is marked");
  await move.click();
  assert.equal(await move.getAttribute("aria-pressed"), "false");
  await drag();
  await until(
    () => fragment(page),
    (now) => now.x !== undefined,
  );
  assert.deepEqual(troubles, []);
  await context.close();
});
