// A layer compared with the picture without it: hidden while a key is held, blinking, and beside a dividing line.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import type { ReadyCase } from "../../web/src/model/case.ts";
import { brainMask, isBrain, markedVolume, nifti } from "./phantom.ts";
import { bare, picturesAgree, show } from "./pixels.ts";
import { type Server, type Stage, fragment, keep, openPage, shown, skip, startStage, until } from "./support.ts";
import { sendCase, sendLayer } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;
let flair: string;
let ball: string;

const FLAIR = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(600 + 300 * Math.sin(x / 7) * Math.cos(z / 9)) : 0));
/** A ball of 30 mm around the middle of the head. */
const BALL = nifti((x, y, z) => (Math.hypot(x, y, z) < 30 ? 1000 : 100));

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
    flair = await sendLayer(server, id, { name: "FLAIR", kind: "mr" }, FLAIR);
    ball = await sendLayer(server, id, { name: "Ball", kind: "mr" }, BALL);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

interface Described {
  readonly id: string;
  readonly name: string;
  readonly state: string;
  readonly kind: string;
  readonly origin?: string;
  readonly case_from_layer?: readonly (readonly number[])[];
}

/** What the server says of a layer. */
const described = async (layer: string): Promise<Described> =>
  (await (await fetch(new URL(`v1/cases/${id}/layers/${layer}`, server.address))).json()) as Described;

/** Where the edges on a slice are: how many pixels they have, their middle, and the circle they make. */
const edgesOn = (page: Page, plane: string) =>
  page.evaluate((selector) => {
    const canvas = document.querySelector<HTMLCanvasElement>(selector);
    const image = canvas?.getContext("2d")?.getImageData(0, 0, canvas.width, canvas.height);
    const places: [number, number][] = [];
    for (let at = 0; image && at < image.data.length; at += 4) {
      const [red = 0, green = 0, blue = 0] = image.data.slice(at, at + 3);
      if (red > 180 && blue > 140 && green < 110)
        places.push([(at / 4) % image.width, Math.floor(at / 4 / image.width)]);
    }
    const ends = ([0, 1] as const).map((axis) => {
      const along = places.map((place) => place[axis]);
      return [Math.min(...along), Math.max(...along)] as const;
    });
    const middle = ends.map(([low, high]) => (low + high) / 2) as [number, number];
    const radius = ends.reduce((sum, [low, high]) => sum + (high - low) / 4, 0);
    const farthest = Math.max(...places.map(([x, y]) => Math.abs(Math.hypot(x - middle[0], y - middle[1]) - radius)));
    return { count: places.length, middle, radius, deviation: farthest / radius };
  }, `.slice.${plane} canvas`);

/** How the edges that the page draws on a slice are alike to those of the server at an address. */
const edgesAgree = (
  page: Page,
  plane: string,
  address: string,
): Promise<{ readonly share: number; readonly count: number }> =>
  page.evaluate(
    async ([selector, address]) => {
      const canvas = document.querySelector<HTMLCanvasElement>(selector);
      if (!canvas) throw new Error(`no ${selector}`);
      const { width, height } = canvas;
      const answer = await fetch(`${address}&width=${width}&height=${height}`);
      if (!answer.ok) throw new Error(`${address}: ${await answer.text()}`);
      const drawn = document.createElement("canvas");
      Object.assign(drawn, { width, height });
      drawn.getContext("2d")?.drawImage(await createImageBitmap(await answer.blob()), 0, 0);
      const pixels = (of: HTMLCanvasElement): Uint8ClampedArray =>
        of.getContext("2d")?.getImageData(0, 0, width, height).data ?? new Uint8ClampedArray();
      const [own, other] = [pixels(canvas), pixels(drawn)];
      let [count, alike] = [0, 0];
      for (let at = 0; at < own.length; at += 4) {
        const level = (of: Uint8ClampedArray, channel: number): number => of[at + channel] ?? 0;
        // Nothing else on a slice without contours is coloured.
        if (level(own, 0) <= level(own, 1) + 8 && level(other, 0) <= level(other, 1) + 8) continue;
        const off = [0, 1, 2].map((channel) => Math.abs(level(own, channel) - level(other, channel)));
        count += 1;
        alike += Math.max(...off) <= 8 ? 1 : 0;
      }
      return { share: alike / count, count };
    },
    [`.slice.${plane} canvas`, address] as const,
  );

/** The two sides of a picture as data URLs, without what is near the line between them. */
async function sides(page: Page, selector: string): Promise<{ readonly left: string; readonly right: string }> {
  const box = await page.locator(selector).boundingBox();
  assert.ok(box);
  const width = Math.floor(box.width / 2) - 12;
  const clip = { y: Math.ceil(box.y) + 40, width, height: Math.floor(box.height) - 80 };
  const taken = async (x: number): Promise<string> =>
    `data:image/png;base64,${(await page.screenshot({ clip: { ...clip, x } })).toString("base64")}`;
  const [left, right] = [Math.ceil(box.x), Math.ceil(box.x + box.width / 2) + 12];
  return { left: await taken(left), right: await taken(right) };
}

test("a line divides surface and slices: the case on its left, the layer on its right", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.goto(`${new URL("/", server.address)}#${id}&l=slices&r=mesh&d=12`);
  await shown(page);
  // A notice that comes or goes meanwhile would change the size of the panes.
  await page.evaluate(() => document.styleSheets[0]?.insertRule(".notice-line { display: none !important }"));
  // The page draws the slices that are wanted once it has the whole volume.
  await page.waitForSelector("canvas.cortex[data-whole=true]", { state: "attached" });
  for (const convention of ["", "&c=n"]) {
    const seen = async (rest: string, surface: string, slice: string) => {
      await show(page, `#${id}&l=slices&r=mesh${convention}${rest}`, "mesh");
      await page.waitForSelector(`#surface${surface}`);
      await page.waitForSelector(`.slice.coronal${slice}`);
      if (convention) await page.waitForSelector(".slice.coronal .slice-image.flipped");
      await bare(page);
      const pictures = [await sides(page, "#surface"), await sides(page, ".slice.coronal .slice-view")];
      await bare(page, false);
      return pictures;
    };
    const own = await seen("", '[data-layer=""]', '[data-layer=""]');
    // The server may have drawn the slice before the page had the layer: the pixels are the same.
    const layer = await seen(`&y=${flair}`, `[data-layer="${flair}"]`, `[data-layer="${flair}"]`);
    // The window came with the layer.
    const { w = "" } = await fragment(page);
    const both = await seen(`&y=${flair}&w=${w}&e=0.5`, " .divider:not([hidden])", " .divider:not([hidden])");
    await keep(page, `swipe${convention.slice(1)}`);
    for (const [at, name] of ["surface", "slice"].entries()) {
      const agree = (side: "left" | "right", other: typeof own): Promise<number> =>
        picturesAgree(page, both[at]?.[side] ?? "", other[at]?.[side] ?? "");
      assert.ok((await agree("left", own)) > 0.98, `${name}${convention}: the left side is the case's`);
      assert.ok((await agree("right", layer)) > 0.98, `${name}${convention}: the right side is the layer's`);
      assert.ok((await agree("left", layer)) < 0.9, `${name}${convention}: they differ`);
    }
  }
  const line = await page.locator("#surface .overlay:not(.other) .divider").boundingBox();
  const pane = await page.locator("#surface").boundingBox();
  assert.ok(line && pane);
  await page.mouse.move(line.x + line.width / 2, line.y + line.height / 2);
  await page.mouse.down();
  await page.mouse.move(pane.x + pane.width * 0.25, pane.y + 200, { steps: 3 });
  await page.mouse.up();
  assert.equal((await fragment(page)).e, "0.25");
  await page.locator("#swipe-place").fill("0.7");
  assert.equal((await fragment(page)).e, "0.7");
  await page.focus("#surface");
  await page.keyboard.press("v");
  assert.equal((await fragment(page)).e, undefined);
  assert.deepEqual(troubles, []);
  await context.close();
});

test("the layer is hidden while b is held, and blinks by its button", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.goto(`${new URL("/", server.address)}#${id}&y=${flair}&r=mesh`);
  await shown(page);
  const shows = (layer: string): Promise<unknown> => page.waitForSelector(`#surface[data-layer="${layer}"]`);
  await shows(flair);
  await page.focus("#surface");
  await page.keyboard.down("b");
  await shows("");
  await page.keyboard.up("b");
  await shows(flair);
  const blink = page.getByRole("button", { name: "Blink" });
  await blink.click();
  await shows("");
  await shows(flair);
  await shows("");
  await blink.click();
  await shows(flair);
  assert.equal((await fragment(page)).y, flair);
  assert.equal(await blink.getAttribute("aria-pressed"), "false");
  await keep(page, "blink");
  // Without a layer there is nothing to compare.
  await page.focus("#surface");
  await page.keyboard.press("l");
  await shows(ball);
  await page.keyboard.press("l");
  await shows("");
  await page.keyboard.press("v");
  assert.match((await page.textContent("#live")) ?? "", /Show a layer first/);
  assert.ok(await blink.isHidden());
  assert.deepEqual(troubles, []);
  await context.close();
});

test(
  "slices show the edges of a layer over the case, which is moved by hand and added where it was moved to",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, {}, "images");
    await page.goto(`${new URL("/", server.address)}#${id}&l=slices&r=mesh&y=${ball}`);
    await shown(page);
    await page.waitForSelector("canvas.cortex[data-whole=true]", { state: "attached" });
    const slices = (attributes: string): Promise<unknown> =>
      Promise.all(
        ["axial", "coronal", "sagittal"].map((plane) =>
          page.waitForSelector(`.slice.${plane}[data-way=page]${attributes}`),
        ),
      );
    await slices(`[data-layer="${ball}"][data-edges=""]`);
    assert.equal((await edgesOn(page, "coronal")).count, 0);
    await page.focus("#surface");
    await page.keyboard.press("e");
    await slices(`[data-edges="${ball}"]`);
    assert.equal((await fragment(page)).h, "1");
    assert.match(await page.locator(".slice.axial .pane-title").innerText(), /Edges: Ball$/);
    await keep(page, "edges");
    const before = await edgesOn(page, "coronal");
    // A thin circle: some 1.2 pixels wide.
    assert.ok(before.count > 3 * before.radius && before.count < 14 * before.radius, JSON.stringify(before));
    // Voxels have 2 mm.
    assert.ok(before.deviation < 0.07, JSON.stringify(before));

    // Ten steps of 0.5 mm to the left, which is at the right of a coronal slice.
    await page.focus("#surface");
    await page.keyboard.press("n");
    for (let step = 0; step < 9; step += 1) await page.keyboard.press("ArrowRight");
    await page.getByRole("button", { name: "0.5 mm to the left" }).click();
    await slices(`[data-moved^="1,0,0,5,"]`);
    await page.locator("#surface .layer-title", { hasText: "Ball, moved by hand, not added" }).waitFor();
    assert.match(await page.locator(".nudge").innerText(), /L\s5\.0 · P\s0\.0 · S\s0\.0 mm, turned by 0\.0°/);
    const moved = await edgesOn(page, "coronal");
    const shift_mm = ((moved.middle[0] - before.middle[0]) * 30) / before.radius;
    assert.ok(Math.abs(shift_mm - 5) < 0.8, `moved by ${shift_mm} mm`);
    await keep(page, "nudged");

    await page.getByRole("button", { name: "Add as a layer" }).click();
    await page.waitForSelector(".slice.coronal[data-way=page][data-edges]:not([data-edges=''])[data-moved='']");
    const added = await until(
      async () => (await fragment(page)).y ?? "",
      (layer) => layer !== ball && layer !== "",
    );
    await slices(`[data-edges="${added}"]`);
    const { name, kind, origin, case_from_layer } = await described(added);
    assert.deepEqual([name, kind, origin], ["Ball 2", "mr", "by-hand"]);
    const rows = case_from_layer?.map((row) => row.map((value) => Math.round(value * 1e6) / 1e6));
    assert.deepEqual(rows?.slice(0, 3), [
      [1, 0, 0, 5],
      [0, 1, 0, 0],
      [0, 0, 1, 0],
    ]);
    const kept = await edgesOn(page, "coronal");
    assert.ok(
      Math.hypot(kept.middle[0] - moved.middle[0], kept.middle[1] - moved.middle[1]) < 1.1,
      JSON.stringify(kept),
    );
    await page.locator("#surface .layer-title", { hasText: "Ball 2, placed by hand" }).waitFor();
    const enlarge = page.locator(".slice.axial .slice-bar > .icon-button:last-child");
    await enlarge.click();
    await page.locator(".slice.axial.large .pane-title", { hasText: "Edges: Ball 2, placed by hand" }).waitFor();
    await keep(page, "edges-large");
    await enlarge.click();

    // What is discarded is where it was.
    await page.getByRole("button", { name: "Face up by 0.5°" }).click();
    await page.waitForSelector(".slice.sagittal[data-moved]:not([data-moved=''])");
    assert.match(await page.locator(".nudge").innerText(), /turned by 0\.5°/);
    await page.getByRole("button", { name: "Discard" }).click();
    await slices("[data-moved='']");
    await page.focus("#surface");
    await page.keyboard.press("e");
    await slices("[data-edges='']");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("the edges on a slice of the page are those of the server", { skip, timeout: 600_000 }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  const answer = await fetch(new URL(`v1/cases/${id}`, server.address));
  const { intensity } = (await answer.json()) as ReadyCase;
  const window = `${intensity.window.center},${intensity.window.width}`;
  for (const [layer, other] of [
    [flair, ball],
    [ball, flair],
  ] as const) {
    await page.goto(`${new URL("/", server.address)}#${id}&l=slices&r=mesh&h=1&x=4,-6,8&b=${layer}&w=${window}`);
    await shown(page);
    await page.focus("#surface");
    await page.keyboard.press("o");
    for (const [plane, position] of [
      ["axial", 8],
      ["coronal", -6],
      ["sagittal", 4],
    ] as const) {
      await page.waitForSelector(`.slice.${plane}[data-way=page][data-edges="${layer}"][data-position="${position}"]`);
      const address = `/v1/cases/${id}/slices/${plane}?position_mm=${position}&window=${window}&edges=true`;
      // The slice may have to be drawn once more, without contours.
      const found = await until(
        () => edgesAgree(page, plane, `${address}&overlay=${layer}`),
        ({ share }) => share >= 0.97,
        60,
      );
      const words = `${layer === flair ? "FLAIR" : "ball"}, ${plane}: ${JSON.stringify(found)}`;
      console.log(words);
      assert.ok(found.count > 300 && found.share >= 0.97, words);
      const wrong = await edgesAgree(page, plane, `${address}&overlay=${other}`);
      assert.ok(wrong.share < 0.5, JSON.stringify(wrong));
    }
    await keep(page, `edges-of-${layer === flair ? "flair" : "ball"}`);
    await page.goto("about:blank");
  }
  assert.deepEqual(troubles, []);
  await context.close();
});

test("slices of the acquired plane say which image of which series they are", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.route(
    (url) => /\/v1\/cases(\/search|\/[0-9a-f]{32})?$/.test(url.pathname),
    async (route) => {
      const response = await route.fetch();
      const json = (await response.json()) as { volume: object } & { cases?: readonly { volume: object }[] };
      const images = [{ slice: 1, count: 60, number: 60, step: -1 }];
      const told = <One extends { volume: object }>(one: One): One => ({
        ...one,
        volume: { ...one.volume, series_number: 3, images },
      });
      await route.fulfill({ response, json: json.cases ? { ...json, cases: json.cases.map(told) } : told(json) });
    },
  );
  // Slices are 2 mm apart from −59 mm on: 11 mm above the middle lies the 36th, whose image is number 25.
  await page.goto(`${new URL("/", server.address)}#${id}&l=slices&x=0,0,11`);
  await shown(page);
  await page.locator(".slice.axial .pane-title", { hasText: "image 25 of 60, series 3" }).waitFor();
  assert.doesNotMatch(await page.locator(".slice.coronal .pane-title").innerText(), /image/);
  assert.deepEqual(troubles, []);
  await context.close();
});
