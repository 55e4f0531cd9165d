// A layer compared with the picture without it: hidden while a key is held, blinking, and beside a dividing line.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { brainMask, isBrain, markedVolume, nifti } from "./phantom.ts";
import { bare, picturesAgree, show } from "./pixels.ts";
import {
  type Server,
  fragment,
  keep,
  launchBrowser,
  openPage,
  readyCase,
  scratchFolder,
  shown,
  skip,
  startServer,
  until,
} from "./support.ts";

let scratch: Awaited<ReturnType<typeof scratchFolder>>;
let server: Server;
let browser: Browser;
let id: string;
let flair: string;

const FLAIR = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(600 + 300 * Math.sin(x / 7) * Math.cos(z / 9)) : 0));

before(
  async () => {
    if (skip) return;
    scratch = await scratchFolder();
    server = await startServer({ command: "serve", data: scratch.folder });
    const send = async (path: string, parts: Readonly<Record<string, Buffer | string>>): Promise<{ id: string }> => {
      const form = new FormData();
      for (const [name, part] of Object.entries(parts))
        form.append(name, new Blob([typeof part === "string" ? part : new Uint8Array(part)]), `${name}.nii`);
      const answer = await fetch(new URL(path, server.address), { method: "POST", body: form });
      return (await answer.json()) as { id: string };
    };
    await send("v1/cases", { volume: markedVolume(), mask: brainMask() });
    id = await readyCase(server.address);
    const parameters = JSON.stringify({ name: "FLAIR", kind: "mr", transform: "none" });
    flair = (await send(`v1/cases/${id}/layers`, { parameters, volume: FLAIR })).id;
    const layer = await until(
      async () => (await (await fetch(new URL(`v1/cases/${id}/layers/${flair}`, server.address))).json()) as unknown,
      (one) => /ready|failed/.test((one as { state: string }).state),
    );
    assert.equal((layer as { state: string }).state, "ready", JSON.stringify(layer));
    browser = await launchBrowser();
  },
  { timeout: 600_000 },
);

after(async () => {
  await browser?.close();
  await server?.stop();
  await scratch?.clean();
});

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
  const { page, troubles, context } = await openPage(browser);
  await page.goto(`${new URL("/", server.address)}#${id}&l=slices&r=mesh&d=12`);
  await shown(page);
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
  const { page, troubles, context } = await openPage(browser);
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
  await shows("");
  await page.keyboard.press("v");
  assert.match((await page.textContent("#live")) ?? "", /Show a layer first/);
  assert.ok(await blink.isHidden());
  assert.deepEqual(troubles, []);
  await context.close();
});
