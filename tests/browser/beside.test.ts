// Two layers side by side: two halves with one camera, one depth and one cross.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, isBrain, markedVolume, nifti } from "./phantom.ts";
import { agreement, bare, canvasSize, show } from "./pixels.ts";
import {
  type Server,
  type Stage,
  brightest,
  fragment,
  keep,
  openMenu,
  openPage,
  shown,
  skip,
  startStage,
  tab,
  until,
} from "./support.ts";
import { sendCase, sendLayer } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;
let flair: string;
let pet: string;

const FLAIR = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(600 + 300 * Math.sin(x / 7) * Math.cos(z / 9)) : 0));
/** Where the bright ball is: on the patient's right, LPS mm. */
const MARK = [-38, 0, 0] as const;
const PET = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(500 + 400 * Math.sin(y / 12)) : 0));

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
    flair = await sendLayer(server, id, { name: "FLAIR", kind: "mr" }, FLAIR);
    pet = await sendLayer(server, id, { name: "PET", kind: "pet" }, PET);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

/** Waits until the halves show these; a half is a texture and a layer in colours, with a comma between. */
const halves = (page: Page, left: string, right: string): Promise<unknown> => {
  const [layer = "", overlay = ""] = right.split(",");
  return page.waitForSelector(`#surface[data-beside="${left}"][data-layer="${layer}"][data-overlay="${overlay}"]`);
};

/** The server's picture of a half. */
const rendered = (layer: string, window: string, [width, height]: readonly [number, number]): string => {
  const query = new URLSearchParams({ view: "left", depth_mm: "12", renderer: "mesh", window });
  if (layer) query.set("layer", layer);
  return new URL(`v1/cases/${id}/render?${query}&contours=80&points=50&width=${width}&height=${height}`, server.address)
    .href;
};

test("two halves show two layers, which keys choose and the address brings back", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  const base = new URL("/", server.address).href;
  await page.goto(`${base}#${id}&r=mesh&d=12&v=left&g=0`);
  await shown(page);
  await page.waitForSelector("canvas.cortex[data-complete=true]", { state: "attached" });
  await page.focus("#surface");
  // Without a layer there is nothing to compare.
  await page.keyboard.press("p");
  assert.equal((await fragment(page)).t, undefined);
  await page.keyboard.press("l");
  await page.waitForSelector(`#surface[data-layer="${flair}"]`);
  await page.keyboard.press("p");
  await halves(page, ",", flair);
  const badges = (): Promise<string[]> => page.locator("#surface .badge").allInnerTexts();
  assert.deepEqual(await badges(), ["the case itself", "FLAIR"]);
  await page.keyboard.press("w");
  await halves(page, `${flair},`, "");
  await page.keyboard.press("l");
  await halves(page, `${flair},`, flair);
  await page.keyboard.press("l");
  await halves(page, `${flair},`, pet);
  await page.locator("#surface .badge", { hasText: /^PET$/ }).waitFor();
  assert.equal(await page.getByRole("button", { name: "Side by side" }).getAttribute("aria-pressed"), "true");
  const said = await until(
    () => fragment(page),
    ({ y, ty }) => y === pet && ty === flair,
  );
  assert.equal(said.t, "1");
  // Each half has its window: that of a PET begins at 0.
  const bars = await page.locator("#surface .colour-bar:not(.map-bar)").allInnerTexts();
  assert.equal(new Set(bars).size, 2, bars.join(" | "));
  assert.match(bars[0] ?? "", /^PET[^]*\s0$/);
  assert.match(bars[1] ?? "", /^FLAIR/);
  await keep(page, "beside");

  // The same after the page has been left, and both halves are the server's pictures.
  const address = page.url();
  await page.goto("about:blank");
  await page.goto(address);
  await shown(page);
  await halves(page, `${flair},`, pet);
  await show(page, `${new URL(address).hash}&z=1`, "mesh");
  await bare(page);
  const [width, height] = await canvasSize(page);
  const half = Math.floor(width / 2);
  const part = (at: number) => ({ left: at * (width - half), width: half, is_flipped: false });
  const share = async (layer: string, window = "", at: number): Promise<number> =>
    (await agreement(page, rendered(layer, window, [half, height]), part(at))).share;
  const found = [await share(flair, said.tw, 0), await share(pet, said.w, 1), await share(pet, said.w, 0)];
  console.log(`halves within 4/255 of the server's: ${found.map((one) => (100 * one).toFixed(2)).join(", ")} %`);
  assert.ok(found[0] !== undefined && found[0] >= 0.98, `left: ${found[0]}`);
  assert.ok(found[1] !== undefined && found[1] >= 0.98, `right: ${found[1]}`);
  assert.ok(found[2] !== undefined && found[2] < 0.9, `they differ: ${found[2]}`);
  await bare(page, false);

  // Undone, and away again.
  await page.focus("#surface");
  await page.keyboard.press("p");
  await page.waitForSelector(`#surface[data-beside=""][data-layer="${pet}"]`);
  await page.keyboard.press("Control+z");
  await halves(page, `${flair},`, pet);
  await page.getByRole("button", { name: "Swap halves" }).click();
  await halves(page, `${pet},`, flair);
  await page.getByRole("button", { name: "Mirror", exact: true }).click();
  await page.waitForSelector(`#surface.halved[data-beside=""][data-layer="${flair}"]`);
  assert.equal((await fragment(page)).t, undefined);
  assert.deepEqual(troubles, []);
  await context.close();
});

test("a point that is marked in either half is marked in both, and slices show the right half", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.goto(
    `${new URL("/", server.address)}#${id}&r=mesh&d=12&v=left&l=slices&y=${pet}&t=1&ty=${flair}&tw=600,700`,
  );
  await shown(page);
  await page.waitForSelector("canvas.cortex[data-complete=true]", { state: "attached" });
  await halves(page, `${flair},`, pet);
  await page.waitForSelector(`.slice.coronal[data-layer="${pet}"]`);
  const box = await page.locator("#surface").boundingBox();
  assert.ok(box);
  const marked = async (x: number): Promise<string> => {
    const before = (await fragment(page)).x;
    await page.mouse.dblclick(x, box.y + box.height * 0.45);
    const { x: position = "" } = await until(
      () => fragment(page),
      (now) => now.x !== undefined && now.x !== before,
    );
    return position;
  };
  const crosses = async (): Promise<readonly (readonly [number, number])[]> => {
    const marks = page.locator("#surface .cursor.mark:not([hidden])");
    await until(
      () => marks.count(),
      (count) => count === 2,
    );
    const boxes = await Promise.all([0, 1].map((at) => marks.nth(at).boundingBox()));
    return boxes.map((one) => [(one?.x ?? 0) + (one?.width ?? 0) / 2, (one?.y ?? 0) + (one?.height ?? 0) / 2]);
  };
  const left = await marked(box.x + box.width * 0.2);
  const [first = [0, 0], second = [0, 0]] = await crosses();
  assert.ok(Math.abs(first[0] - (box.x + box.width * 0.2)) < 2, `${first} in ${JSON.stringify(box)}`);
  assert.ok(Math.abs(second[0] - first[0] - box.width / 2) < 1.5 && Math.abs(second[1] - first[1]) < 1, `${second}`);
  await marked(box.x + box.width * 0.3);
  // The same place of the right half is the same point, but for the pixel: half of an odd width is none.
  const numbers = (position: string): readonly number[] => position.split(",").map(Number);
  const right = numbers(await marked(box.x + box.width * 0.7));
  const off_mm = Math.hypot(...numbers(left).map((part, axis) => part - (right[axis] ?? NaN)));
  assert.ok(off_mm < 0.6, `${left} and ${right.join()}`);
  await keep(page, "beside-marked");
  assert.deepEqual(troubles, []);
  await context.close();
});

test("the server draws both halves, and a saved picture names both layers", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.goto(`${new URL("/", server.address)}?renderer=server#${id}&d=12&y=${pet}&t=1&ty=${flair}&tw=600,700`);
  await page.waitForSelector("#surface .server-picture.other img");
  await halves(page, `${flair},`, pet);
  assert.equal(await page.locator(".served.mirrored").count(), 0);
  await keep(page, "beside-served");
  await openMenu(page, "export");
  const texts: string[] = [];
  await page.exposeFunction("heard", (text: string) => texts.push(text));
  await page.evaluate(() => {
    const { prototype } = CanvasRenderingContext2D;
    const draw = prototype.fillText;
    prototype.fillText = function (text, ...place) {
      void (globalThis as unknown as { heard(text: string): void }).heard(text);
      return draw.call(this, text, ...place);
    };
  });
  const [file] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "Save picture" }).click(),
  ]);
  await file.saveAs("target/browser/beside-saved.png");
  await until(
    async () => texts.join(" "),
    (all) => /Left half: Window C 600 W 700, In grey: FLAIR/.test(all) && /Right half:.*In grey: PET/.test(all),
  );
  assert.deepEqual(troubles, []);
  await context.close();
});

test("the left half has a layer in colours; once that is deleted, it shows the case itself", { skip }, async () => {
  const { page, troubles, context } = await openPage(browser, {}, "images");
  await page.goto(`${new URL("/", server.address)}#${id}&r=mesh&d=12&y=${flair}&t=1&tb=${pet},,0.5`);
  await shown(page);
  await halves(page, `,${pet}`, flair);
  await page.locator("#surface .of-left .map-bar", { hasText: /^PET/ }).waitFor();
  assert.equal(await page.locator("#surface > .map-bar").isHidden(), true);
  await keep(page, "beside-colours");
  // What is held away is that of the right half.
  await page.focus("#surface");
  await page.keyboard.down("b");
  await halves(page, `,${pet}`, "");
  await page.keyboard.up("b");
  await halves(page, `,${pet}`, flair);
  // A line divides the picture alone.
  await page.keyboard.press("v");
  await page.waitForSelector(`#surface[data-beside=""] .overlay:not(.other) .divider:not([hidden])`);
  await page.keyboard.press("Control+z");
  await halves(page, `,${pet}`, flair);
  await page.locator(`.layers li[data-id="${pet}"] [data-do=delete]`).click();
  await page.locator("dialog.confirm-delete button[value=delete]").click();
  await halves(page, ",", flair);
  await page.locator(".layers-note", { hasText: /\w/ }).waitFor();
  assert.equal((await fragment(page)).tb, undefined);
  assert.deepEqual(troubles, []);
  await context.close();
});

test(
  "z looks closer: 60 mm around the mark, the other side flipped, the layer beside the case with a window of its own",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, {}, "images");
    await page.goto(`${server.address}?renderer=server#${id}&l=both&w=650,701&x=${MARK.join()}`);
    await shown(page);
    const drawn = async (columns: number): Promise<void> => {
      await page.waitForFunction(
        (count) => document.querySelectorAll(".closer .slice[data-position] .slice-image > *").length === count,
        3 * columns,
      );
    };
    await page.locator("#surface").focus();
    await page.keyboard.press("z");
    await drawn(2);
    assert.deepEqual(await violations(page), []);
    const pane = (plane: string, name: string): ReturnType<Page["locator"]> =>
      page.locator(`.closer .slice.${plane}.${name}`);
    // The scale: the smaller side of a pane is 60 mm.
    const frame = await pane("axial", "here").locator(".slice-view").boundingBox();
    const line = await pane("axial", "here").locator(".scale-line").boundingBox();
    const mm = Number.parseInt(await pane("axial", "here").locator(".scale-text").innerText(), 10);
    assert.ok(frame && line);
    const field_mm = (Math.min(frame.width, frame.height) / line.width) * mm;
    assert.ok(Math.abs(field_mm - 60) < 1, String(field_mm));
    // Each pane says its side, and its letters are those of what it shows.
    const letters = async (plane: string, name: string): Promise<string> =>
      (await pane(plane, name).locator(".edge").allInnerTexts()).join(" ");
    const side = (plane: string, name: string): Promise<string> => pane(plane, name).locator(".badge").innerText();
    for (const plane of ["axial", "coronal"]) {
      assert.match(await letters(plane, "here"), /^R L /);
      assert.match(await letters(plane, "opposite"), /^L R /);
    }
    assert.match(await letters("sagittal", "opposite"), /^A P /);
    for (const plane of ["axial", "coronal", "sagittal"]) {
      assert.equal(await side(plane, "here"), "Right");
      assert.equal(await side(plane, "opposite"), "Left (flipped)");
      // What is bright on the right is in the middle of the marked side's slice alone.
      const middle = async (name: string): Promise<number> => {
        const clip = await pane(plane, name).locator(".slice-view").boundingBox();
        assert.ok(clip);
        const [across, down] = [clip.x + clip.width / 2 - 4, clip.y + clip.height / 2 - 4];
        const png = await page.screenshot({ clip: { x: across, y: down, width: 8, height: 8 } });
        return (await brightest(page, png, 200))?.count ?? 0;
      };
      const bright = await until(
        () => middle("here"),
        (count) => count > 30,
        20,
      );
      await keep(page, `closer-${plane}`);
      assert.ok(bright > 30, `${plane}: ${bright}`);
      assert.equal(await middle("opposite"), 0, plane);
    }
    // What is clicked on the other side is what is marked, and the sides change places.
    const other = await pane("axial", "opposite").locator(".slice-view").boundingBox();
    assert.ok(other);
    const place = async (): Promise<number[]> => ((await fragment(page)).x ?? "").split(",").map(Number);
    /** What the read-out says of the place under the pointer. */
    const hovered = async (): Promise<number[]> => {
      const words = await pane("axial", "opposite").locator(".hovered").innerText();
      const numbers = [...words.matchAll(/([LPSRAI])\s(\d+\.\d)/g)].slice(0, 3);
      return numbers.map(([, letter = "", mm]) => Number(mm) * ("RAI".includes(letter) ? -1 : 1));
    };
    const isAt = (marked: readonly number[], read: readonly number[]): boolean =>
      read.length === 3 && read.every((mm, axis) => Math.abs(mm - (marked[axis] ?? NaN)) < 0.06);
    /** The sides that are shown, once the marked one is this. */
    const sides = (here: string): Promise<unknown> =>
      Promise.all(
        ["axial", "coronal", "sagittal"].flatMap((plane) => [
          pane(plane, "here")
            .locator(".badge", { hasText: new RegExp(`^${here}$`) })
            .waitFor(),
          pane(plane, "opposite")
            .locator(".badge", { hasText: here === "Left" ? "Right (flipped)" : "Left (flipped)" })
            .waitFor(),
        ]),
      );
    const [across, down] = [other.x + other.width / 2, other.y + other.height / 2];
    await page.mouse.move(across + 20, down);
    const onLeft = await hovered();
    assert.ok((onLeft[0] ?? 0) > 20, onLeft.join());
    await page.mouse.down();
    // As long as the hand is there, what is below it stays.
    await page.mouse.move(across + 30, down, { steps: 3 });
    await pane("axial", "opposite").locator(".badge", { hasText: "Left (flipped)" }).waitFor();
    await page.mouse.move(across + 20, down);
    await page.mouse.up();
    await sides("Left");
    const left = await place();
    assert.ok(isAt(left, onLeft), `${left.join()}, not ${onLeft.join()}`);
    // The same the other way round.
    await page.mouse.move(across + 21, down);
    const onRight = await until(hovered, ([rightwards = 0]) => rightwards < 0);
    await page.mouse.down();
    await page.mouse.up();
    await sides("Right");
    const right = await place();
    assert.ok(isAt(right, onRight), `${right.join()}, not ${onRight.join()}`);
    // The wheel goes through both sides' slices, and leaves the mark on its own.
    await page.mouse.wheel(0, 120);
    await until(place, ([, , mz]) => Math.abs((mz ?? 0) - (right[2] ?? 0)) > 0.5);
    await sides("Right");
    // A double click enlarges, and marks nothing.
    const before = await place();
    await page.mouse.dblclick(across + 20, down);
    await page.waitForSelector(".closer .slice.axial.opposite.large");
    await sides("Right");
    assert.deepEqual(await place(), before);
    await page.keyboard.press("Escape");
    await page.goto("about:blank");
    await page.goto(`${server.address}?renderer=server#${id}&l=closer&w=650,701&x=${MARK.join()}`);
    await drawn(2);
    await page.locator("#surface").focus();
    // The layer beside the case: its window is not the case's.
    await page.keyboard.press("l");
    await drawn(4);
    assert.match(await pane("axial", "here-layer").locator(".pane-title").innerText(), /FLAIR/);
    assert.match(await pane("axial", "here").locator(".pane-title").innerText(), /T1/);
    const windows = async (): Promise<(string | undefined)[]> => {
      const { w, tw } = await fragment(page);
      return [w, tw];
    };
    const drag = async (name: string): Promise<void> => {
      const box = await pane("axial", name).locator(".slice-view").boundingBox();
      assert.ok(box);
      await page.mouse.move(box.x + 30, box.y + 30);
      await page.mouse.down({ button: "right" });
      await page.mouse.move(box.x + 60, box.y + 30, { steps: 3 });
      await page.mouse.up({ button: "right" });
    };
    const [w, tw] = await windows();
    await drag("opposite");
    const [sameLayer, ownWindow] = await windows();
    assert.equal(sameLayer, w);
    assert.notEqual(ownWindow, tw);
    await drag("here-layer");
    const [layerWindow, sameOwn] = await windows();
    assert.equal(sameOwn, ownWindow);
    assert.notEqual(layerWindow, w);
    await keep(page, "closer");
    // What is saved are the panes of the close-up; keys that divide other layouts do nothing.
    for (const key of ["p", "w", "v"]) await page.keyboard.press(key);
    await drawn(4);
    assert.deepEqual(await windows(), [layerWindow, sameOwn]);
    const waiting = page.waitForEvent("download");
    await openMenu(page, "export");
    await page.getByRole("button", { name: "Save picture" }).click();
    const png = await readFile(await (await waiting).path());
    const bright = await brightest(page, png, 200);
    assert.ok(bright && bright.count > 1000, "the ball is in the picture");
    // Escape closes the box, and that alone.
    await page.keyboard.press("Escape");
    await page.waitForSelector("#menu-export", { state: "hidden" });
    assert.equal((await fragment(page)).l, "closer");
    // The address opens the same, and z goes back to what was before.
    await page.keyboard.press("z");
    const { l, t } = await fragment(page);
    assert.deepEqual([l, t], ["both", undefined]);
    await page.goBack();
    await drawn(4);
    assert.equal((await fragment(page)).l, "closer");
    await pane("axial", "here").focus();
    await page.keyboard.press("Escape");
    assert.notEqual((await fragment(page)).l, "closer");
    // An address may name a layer and no halves: a layer never stands where the case itself is said to be.
    await page.goto("about:blank");
    await page.goto(`${server.address}?renderer=server#${id}&l=closer&y=${flair}&x=${MARK.join()}`);
    await drawn(4);
    await page.keyboard.press("z");
    // Without a mark there is nothing to look at.
    await tab(page, "read");
    await page.getByRole("button", { name: "Remove the mark" }).click();
    // What is said may be followed at once by the description of the next picture.
    await page.evaluate(
      () =>
        new Promise<void>((tell) => {
          const live = document.querySelector("#live");
          if (!live) throw new Error("nothing is said");
          const heard = (): void => void (/Mark a point first/.test(live.textContent ?? "") && tell());
          new MutationObserver(heard).observe(live, { childList: true, characterData: true, subtree: true });
          document.querySelector<HTMLElement>(".layouts button[value=closer]")?.click();
        }),
    );
    assert.notEqual((await fragment(page)).l, "closer");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);
