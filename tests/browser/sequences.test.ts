// Several sequences at once: panes show series of their own, each with its window, chosen from the strip or dragged; slices
// in one plane; the cine; and files that are dropped on an open case.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, isBrain, markedVolume, nifti } from "./phantom.ts";
import {
  COARSE,
  type Server,
  type Stage,
  type Watched,
  brightest,
  fragment,
  keep,
  openPage,
  rested,
  shown,
  skip,
  speak,
  startStage,
  until,
} from "./support.ts";
import { sendCase, sendLayer } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;
let flair: string;
let t2: string;

/** A bright ball of 10 mm in a dim brain, somewhere in RAS mm: the FLAIR has it at the left, the T2 in front. */
const ball = (right: number, front: number): Buffer =>
  nifti((x, y, z) => (!isBrain(x, y, z) ? 0 : Math.hypot(x - right, y - front, z) < 10 ? 1000 : 200));
const FLAIR = ball(-30, 0);
const T2 = ball(0, 40);
const SLICES = ["slice-1", "slice-2", "slice-3"] as const;

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
    flair = await sendLayer(server, id, { name: "FLAIR", kind: "mr" }, FLAIR);
    t2 = await sendLayer(server, id, { name: "T2", kind: "mr" }, T2);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

async function opened(rest: string, query = "?renderer=server", options = COARSE): Promise<Watched> {
  const watched = await openPage(browser, options);
  await watched.page.goto(`${new URL(`/${query}`, server.address)}#${id}${rest}`);
  await shown(watched.page);
  await watched.page.waitForSelector(".strip .chip[data-series]:nth-child(3)");
  return watched;
}

const pane = (page: Page, name: string) => page.locator(`.panes [data-pane=${name}]`);
const chip = (page: Page, series: string) => page.locator(`.chip[data-series="${series}"]`);
/** Chooses a series for a pane by the keyboard alone. */
async function choose(page: Page, name: string, series: string): Promise<void> {
  await pane(page, name).focus();
  await chip(page, series).focus();
  await page.keyboard.press("Enter");
}
const showsLayer = (page: Page, name: string, layer: string): Promise<unknown> =>
  page.waitForSelector(`.panes [data-pane=${name}][data-layer="${layer}"]`);
async function showPlanes(page: Page, ...planes: readonly string[]): Promise<void> {
  for (const [at, plane] of planes.entries())
    await page.waitForSelector(`.slices [data-pane=slice-${at + 1}][data-plane=${plane}]`);
}
const titleOf = (page: Page, name: string): Promise<string> => pane(page, name).locator(".pane-title").innerText();
/** Where the brightest voxels are in the picture of a pane, as shares of it. */
async function brightIn(page: Page, name: string) {
  const found = await brightest(page, await pane(page, name).locator(".slice-image").screenshot(), 240);
  assert.ok(found, name);
  return found;
}

for (const [query, way] of [
  ["?renderer=server", "server"],
  ["", "page"],
] as const) {
  test(
    `three series of one plane stand side by side, each with its own pixels, title and window (drawn by the ${way})`,
    { skip, timeout: 600_000 },
    async () => {
      const { page, troubles } = await opened("&l=slices&x=0,0,0&o=0&m=grey", query, {});
      await page.keyboard.press("o");
      await page.keyboard.press("Shift+T");
      await showPlanes(page, "axial", "axial", "axial");
      await choose(page, "slice-2", flair);
      await choose(page, "slice-3", t2);
      await showsLayer(page, "slice-1", "");
      await showsLayer(page, "slice-2", flair);
      await showsLayer(page, "slice-3", t2);
      if (way === "page")
        await page.waitForFunction(() =>
          [...document.querySelectorAll<HTMLElement>(".slices .slice")].every(({ dataset }) => dataset.way === "page"),
        );
      await rested(page);
      // The right of the patient is at the left of the picture.
      const [own, left, front] = await Promise.all(SLICES.map((name) => brightIn(page, name)));
      assert.ok(own && left && front);
      assert.ok(own.x < 0.45 && Math.abs(own.y - 0.5) < 0.06, JSON.stringify(own));
      assert.ok(left.x > 0.55 && Math.abs(left.y - 0.5) < 0.06, JSON.stringify(left));
      assert.ok(Math.abs(front.x - 0.5) < 0.06 && front.y < 0.4, JSON.stringify(front));
      // The series is the last line of a title.
      await until(
        async () => {
          const titles = await Promise.all(SLICES.map((name) => titleOf(page, name)));
          return titles.map((title) => title.split("\n").at(-1)?.split(",")[0]).join();
        },
        (named) => named === "T1,FLAIR,T2",
      );
      await keep(page, `sequences-${way}`);
      // A window is that of the pane with the focus.
      const windows = async (): Promise<readonly (string | undefined)[]> => {
        const { w, Bw, Cw } = await fragment(page);
        return [w, Bw, Cw];
      };
      const before = await windows();
      await pane(page, "slice-2").focus();
      await page.keyboard.press("2");
      const after = await windows();
      assert.deepEqual([after[0], after[2]], [before[0], before[2]]);
      assert.notEqual(after[1], before[1]);
      await pane(page, "slice-1").focus();
      await page.keyboard.press("5");
      assert.notEqual((await windows())[0], before[0]);
      assert.equal((await windows())[1], after[1]);
      // All of it is in the address.
      const hash = new URL(page.url()).hash;
      await page.goto("about:blank");
      await page.goto(`${new URL(`/${query}`, server.address)}${hash}`);
      await shown(page);
      await showsLayer(page, "slice-2", flair);
      await showsLayer(page, "slice-3", t2);
      assert.equal(new URL(page.url()).hash, hash);
      assert.deepEqual(troubles, []);
      await page.context().close();
    },
  );
}

test(
  "a series is dragged onto a pane alone, and taken from all by a button; the mark, the depth and the slices stay linked",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles } = await opened("&l=slices&x=0,0,0");
    await chip(page, flair).dragTo(pane(page, "slice-2"));
    await showsLayer(page, "slice-2", flair);
    for (const other of ["surface", "slice-1", "slice-3"]) await showsLayer(page, other, "");
    await page.waitForSelector(`.chip[data-series="${flair}"][aria-pressed=true]`);
    // The surface too; in the layout of the flat map, that as well.
    await chip(page, t2).dragTo(pane(page, "surface"));
    await showsLayer(page, "surface", t2);
    await page.locator(".layouts button[value=map]").click();
    await chip(page, flair).dragTo(pane(page, "map"));
    await showsLayer(page, "map", flair);
    await showsLayer(page, "surface", t2);
    await page.locator(".layouts button[value=slices]").click();
    // What one slice marks, all show.
    await pane(page, "slice-1").focus();
    await page.keyboard.press("ArrowUp");
    const { x } = await fragment(page);
    assert.equal(x, "0,0,1");
    await page.waitForFunction(() =>
      [...document.querySelectorAll(".slices .slice")].every((one) => one.querySelector(".cursor:not([hidden])")),
    );
    await page.locator("#depth-number").fill("7");
    await page.keyboard.press("Enter");
    await page.waitForFunction(() =>
      [...document.querySelectorAll<HTMLElement>(".surface, .slices .slice")].every((one) => one.dataset.depth === "7"),
    );
    await page.getByRole("button", { name: "Same in all panes" }).click();
    for (const name of ["surface", ...SLICES]) await showsLayer(page, name, "");
    await rested(page);
    assert.doesNotMatch(new URL(page.url()).hash, /&[SABCXM]=/);
    // One step back undoes it.
    await page.keyboard.press("Control+z");
    await showsLayer(page, "slice-2", flair);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "without slices, and in the close-up, the strip chooses for all that is seen, or for a half",
  { skip },
  async () => {
    const { page, troubles } = await opened("&x=-38,0,0");
    await chip(page, flair).click();
    await showsLayer(page, "surface", flair);
    assert.equal((await fragment(page)).S, undefined);
    await page.keyboard.press("z");
    await page.waitForSelector(`.closer .here-layer[data-layer="${flair}"]`);
    await page.locator(".closer .axial.here").focus();
    await chip(page, t2).click();
    await page.waitForSelector(`.closer .axial.here[data-layer="${t2}"]`);
    await page.waitForSelector(`.closer .axial.here-layer[data-layer="${flair}"]`);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test("slices in one plane lie alike under a hand, and keep their zoom when their planes change", { skip }, async () => {
  const { page, troubles } = await opened("&l=slices&x=0,0,0&n=coronal&z=2");
  const transforms = (): Promise<readonly string[]> =>
    page.locator(".slices .slice-image").evaluateAll((all) => all.map((one) => (one as HTMLElement).style.transform));
  const sources = (): Promise<readonly string[]> =>
    page.locator(".slices .slice").evaluateAll((all) => all.map((one) => (one as HTMLElement).dataset.position ?? ""));
  const box = await pane(page, "slice-2").locator(".slice-view").boundingBox();
  assert.ok(box);
  await page.mouse.move(box.x + box.width / 3, box.y + box.height / 3);
  await page.keyboard.down("Control");
  await page.mouse.wheel(0, -200);
  await page.keyboard.up("Control");
  await page.keyboard.down("Shift");
  await page.mouse.down();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2, { steps: 4 });
  await page.mouse.up();
  await page.keyboard.up("Shift");
  await rested(page);
  await until(transforms, (all) => new Set(all).size === 1 && all.length === 3);
  const letters = await page.locator(".slices .slice .edge.left").allInnerTexts();
  assert.deepEqual(letters, ["R", "R", "R"]);
  // A click marks in all, and moves none.
  const crosses = (): Promise<readonly string[]> =>
    page
      .locator(".slices .slice .cursor >> visible=true")
      .evaluateAll((all) => all.map((one) => (one as SVGElement).style.left));
  const [before] = await crosses();
  await page.mouse.click(box.x + 0.6 * box.width, box.y + 0.45 * box.height);
  await until(crosses, (all) => all.length === 3 && new Set(all).size === 1 && all[0] !== before);
  assert.equal(new Set(await sources()).size, 1);
  await page.locator("#planes").selectOption({ label: "Three planes" });
  await showPlanes(page, "axial", "coronal", "sagittal");
  assert.deepEqual(troubles, []);
  await page.context().close();
});

test("the strip is worked by keys, speaks both languages, and is accessible", { skip, timeout: 300_000 }, async () => {
  const { page, troubles } = await opened("&l=slices");
  await pane(page, "slice-3").focus();
  for (const layer of [flair, t2]) {
    await page.keyboard.press("Shift+N");
    await showsLayer(page, "slice-3", layer);
  }
  assert.deepEqual(await violations(page), []);
  await speak(page, "pt-BR");
  await shown(page);
  await page.getByRole("button", { name: "Igual em todos os painéis" }).waitFor();
  await page.keyboard.press("Shift+E");
  await page.waitForSelector(".strip", { state: "detached" });
  await speak(page, "en");
  assert.deepEqual(troubles, []);
  await page.context().close();
});

test("a saved layout keeps the series of panes by their kind, and of no patient", { skip }, async () => {
  const { page, troubles } = await opened("&l=slices&n=axial");
  await page.evaluate(
    async ([layer, address]) => {
      await fetch(`v1/cases/${address}/layers/${layer}`, {
        method: "PATCH",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ contrast: "flair" }),
      });
    },
    [flair, id],
  );
  await page.reload();
  await shown(page);
  await chip(page, flair).dragTo(pane(page, "slice-2"));
  await showsLayer(page, "slice-2", flair);
  await page.locator(".group", { hasText: "Saved layouts" }).locator("summary").click();
  await page.locator("#layout-name").fill("side by side");
  await page.keyboard.press("Enter");
  const stored = await until(
    () => page.evaluate(() => localStorage["isocortex-layouts"] as string | undefined),
    (layouts) => layouts?.includes('"slice-2":"layer:flair"') ?? false,
  );
  assert.ok(!stored?.includes(flair));
  await page.getByRole("button", { name: "Same in all panes" }).click();
  await page.locator("#planes").selectOption({ label: "Three planes" });
  await showsLayer(page, "slice-2", "");
  await page.locator(".saved-layouts button", { hasText: "side by side" }).click();
  await showsLayer(page, "slice-2", flair);
  assert.equal((await fragment(page)).n, "axial");
  assert.deepEqual(troubles, []);
  await page.context().close();
});

test("the cine moves the slices of a plane there and back until any input stops it", { skip }, async () => {
  const { page, troubles } = await opened("&l=slices&x=0,0,0");
  const position = async (): Promise<number> =>
    Number(await pane(page, "slice-2").locator(".slice-range").inputValue());
  await pane(page, "slice-2").focus();
  await page.keyboard.press("Shift+C");
  await page.waitForSelector("[data-cine=coronal][aria-pressed=true]");
  const first = await position();
  await until(position, (now) => Math.abs(now - first) >= 3);
  assert.equal(Number(await pane(page, "slice-1").locator(".slice-range").inputValue()), 0);
  await page.mouse.wheel(0, 1);
  await page.waitForSelector("[data-cine=coronal][aria-pressed=false]");
  // Its key and its button start and stop it.
  const button = page.locator("[data-cine=axial]");
  await button.click();
  await page.waitForSelector("[data-cine=axial][aria-pressed=true]");
  await button.click();
  await page.waitForSelector("[data-cine=axial][aria-pressed=false]");
  await page.keyboard.press("Shift+C");
  await page.waitForSelector("[data-cine][aria-pressed=true]");
  await page.keyboard.press("ArrowLeft");
  await page.waitForSelector("[data-cine][aria-pressed=true]", { state: "detached" });
  const { x } = await fragment(page);
  await rested(page);
  assert.equal((await fragment(page)).x, x);
  assert.deepEqual(troubles, []);
  await page.context().close();
});

test("files that are dropped on an open case become its layers or another case, as is answered", { skip }, async () => {
  const { page, troubles } = await opened("&l=slices");
  const drop = (name: string, bytes: Buffer): Promise<void> =>
    page.evaluate(
      ([title, base64]) => {
        const transfer = new DataTransfer();
        const data = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
        transfer.items.add(new File([data], title));
        for (const type of ["dragover", "drop"])
          document
            .querySelector("#surface")
            ?.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: transfer }));
      },
      [name, bytes.toString("base64")] as const,
    );
  const dialog = page.locator("dialog.dropped");
  const swi = ball(0, -40);
  await drop("Silva_swi.nii", swi);
  assert.ok(!(await dialog.innerText()).includes("Silva"));
  await page.keyboard.press("Escape");
  await dialog.waitFor({ state: "detached" });
  await drop("Silva_swi.nii", swi);
  await dialog.getByRole("button", { name: "Layer of this case" }).click();
  await page.locator(".layers li[data-state=ready]", { hasText: "SWI" }).waitFor();
  await page.locator(".chip", { hasText: "SWI" }).waitFor();
  await drop("another.nii", markedVolume(5));
  await dialog.getByRole("button", { name: "New case" }).click();
  await page.locator("#add .chosen", { hasText: "MB" }).waitFor();
  assert.deepEqual(troubles, []);
  await page.context().close();
});
