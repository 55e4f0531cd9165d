// The flat map: drawn by the page as the server draws it, left on the left; and the hands on it.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import { mapAgrees } from "./pixels.ts";
import {
  type Server,
  type Stage,
  fragment,
  keep,
  openPage,
  rested,
  shown,
  skip,
  startStage,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let page: Page;
let troubles: readonly string[] = [];
let id: string;

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    ({ page, troubles } = await openPage(browser));
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
    await page.goto(new URL(`/#${id}&l=map&r=exact`, server.address).href);
    await shown(page);
    await page.waitForSelector(".flat-map[data-way=page][data-known]");
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

test("the page draws the map that the server draws, with the right side on the right", { skip }, async () => {
  const share = await mapAgrees(page, server.address, id);
  assert.ok(share > 0.99, `${share}`);
  // The ball lies on the patient's right: the only bright place of the right disc's middle.
  const [left, right] = await page.locator(".map-image canvas").evaluate((canvas: HTMLCanvasElement) => {
    const { width, height } = canvas;
    const data = canvas.getContext("2d")?.getImageData(0, 0, width, height).data ?? new Uint8ClampedArray();
    const at = (share: number): number => data[4 * (Math.floor(height / 2) * width + Math.floor(share * width))] ?? 0;
    return [at(0.25), at(0.75)] as const;
  });
  assert.ok(right > 250 && left < 250, `${left} ${right}`);
  assert.deepEqual(await page.locator(".map-lines .side").allTextContents(), ["L", "R"]);
  assert.deepEqual(await page.locator(".map-lines .rim").allTextContents(), [..."PASI", ..."APSI"]);
  assert.ok(((await page.locator(".graticule").first().getAttribute("d")) ?? "").length > 1000);
  assert.deepEqual(await violations(page), []);
  await keep(page, "flat-map");
});

test(
  "a click marks what the map shows there, the surface turns to it, and planes go through it",
  { skip },
  async () => {
    const box = await page.locator(".flat-map").boundingBox();
    assert.ok(box);
    await page.mouse.move(box.x + 0.75 * box.width, box.y + 0.5 * box.height);
    await page.waitForSelector(".scale-disc:not([hidden])");
    assert.match(await page.locator(".map-scale").innerText(), /10 mm.*100 pixels here: \d+ mm/);
    await page.mouse.click(box.x + 0.75 * box.width, box.y + 0.5 * box.height);
    const { x = "", v } = await fragment(page);
    const [left = 0, posterior = 99, superior = 99] = x.split(",").map(Number);
    // 10 mm below the rightmost point of the brain, which reaches 50 mm to the right.
    assert.ok(left < -33 && left > -45, x);
    assert.ok(Math.hypot(posterior, superior) < 8, x);
    assert.notEqual(v, "left");
    await page.waitForSelector(".flat-map .cursor.mark:not([hidden])");
    for (const plane of ["axial", "coronal"])
      assert.ok(((await page.locator(`.map-lines .${plane}`).getAttribute("d")) ?? "").length > 200, plane);
    await page.waitForSelector(".flat-map[data-looking=right]");
  },
);

test("keys and wheel move the map alone, and the address keeps it", { skip }, async () => {
  await page.locator(".flat-map").focus();
  const { z: zoom, p: pan } = await fragment(page);
  await page.keyboard.press("+");
  await page.keyboard.press("ArrowRight");
  await rested(page);
  const { j: map = "", z, p } = await fragment(page);
  assert.deepEqual([z, p], [zoom, pan], "the surface stays");
  assert.match(map, /^1\.2,[\d.]+,0$/);
  await page.keyboard.press("Home");
  await until(
    () => fragment(page),
    ({ j }) => j === undefined,
  );
  // The ellipsoid has no fissure, and so no inner sides: the page says so, and shows the outer ones. Until it knows, the
  // picture of the outer ones stands with its own letters.
  let answer = (): void => {};
  const isAnswered = new Promise<void>((resolve) => (answer = resolve));
  await page.route(/\/render\?.*sides=both/, async (route) => {
    await isAnswered;
    await route.continue();
  });
  await page.keyboard.press("m");
  const picture = page.locator(".map-image");
  await until(
    () => page.locator(".map-inner").getAttribute("aria-pressed"),
    (pressed) => pressed === "true",
  );
  assert.equal(await picture.isVisible(), true);
  assert.deepEqual(await page.locator(".map-lines .side").allTextContents(), ["L", "R"]);
  answer();
  await page.waitForSelector(".notice-line.remark:not([hidden])");
  await page.waitForSelector(".flat-map[data-inner=false]");
  await picture.waitFor({ state: "visible" });
  const { i } = await until(
    () => fragment(page),
    ({ i: inner }) => inner === undefined,
  );
  assert.equal(i, undefined);
  assert.deepEqual(
    troubles.filter((trouble) => !trouble.includes("409")),
    [],
  );
});
