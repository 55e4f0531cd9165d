// The ruler against a head of 100 mm and a ball; what is measured becomes a finding, which follows the depth.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, isBrain, nifti } from "./phantom.ts";
import {
  type Server,
  type Stage,
  findingsOf,
  keep,
  openMenu,
  openPage,
  rested,
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
/** A head that is 100 mm wide, 124 mm long and 92 mm high, and a ball of 46 mm. */
let head: string;
let ball: string;
const BALL_MM = 46;

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    const volume = nifti((x, y, z) => (isBrain(x, y, z) ? 300 : 0));
    head = await sendCase(server, { volume, mask: brainMask() });
    const isBall = (x: number, y: number, z: number): boolean => Math.hypot(x, y, z) < BALL_MM;
    const [round, mask] = [300, 1].map((value) => nifti((x, y, z) => (isBall(x, y, z) ? value : 0)));
    assert.ok(round && mask);
    ball = await sendCase(server, { volume: round, mask });
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

/** The number in words such as `Length 100.0 mm`. */
const valueOf = (words = ""): number => Number(/-?\d[\d,]*(\.\d+)?/.exec(words)?.[0].replace(",", ""));
const within = (value: number, wanted: number): void =>
  assert.ok(Math.abs(value - wanted) <= 0.01 * wanted, `${value} is not ${wanted}`);
const last = (page: Page): Promise<string> => page.locator(".measures li").last().locator(".value").innerText();

/** Where what is lit begins and ends in the middle row of a slice, in pixels of the window. */
async function edges(page: Page, plane: string): Promise<{ left: number; right: number; middle: number }> {
  return page.evaluate((name) => {
    const picture = document.querySelector<HTMLCanvasElement | HTMLImageElement>(
      `.slice.${name} .slice-image :is(canvas, img)`,
    );
    if (!picture) throw new Error("no picture");
    const [width, height] =
      picture instanceof HTMLImageElement
        ? [picture.naturalWidth, picture.naturalHeight]
        : [picture.width, picture.height];
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d");
    if (!context) throw new Error("no canvas");
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, Math.floor(height / 2), width, 1);
    const lit = Array.from({ length: width }, (_, at) => (data[4 * at] ?? 0) > 127 && (data[4 * at + 2] ?? 0) > 127);
    const box = picture.getBoundingClientRect();
    const place = (at: number): number => box.left + (at * box.width) / width;
    return {
      left: place(lit.indexOf(true)),
      right: place(lit.lastIndexOf(true) + 1),
      middle: box.top + box.height / 2,
    };
  }, plane);
}

test(
  "in a slice the ruler measures the head within 1 %, in lengths, angles and areas; an area becomes a finding",
  { skip, timeout: 300_000 },
  async () => {
    const { page, context, troubles } = await openPage(browser);
    // Black and white meet half-way up the border of the head.
    await page.goto(new URL(`#${head}&l=slices&w=150,3&x=0,0,0`, server.address).href);
    await shown(page);
    await page.locator(".slice.axial .icon-button:last-child").click();
    await page.waitForSelector(".slice.axial.large[data-way=page]");
    await page.keyboard.press("o");
    await until(
      () => edges(page, "axial"),
      ({ left, right }) => right - left > 300,
    );
    const { left, right, middle } = await edges(page, "axial");
    const scale = (right - left) / 100;
    await page.keyboard.press("k");
    await page.waitForSelector("body[data-tool=length]");
    await page.mouse.click(left, middle);
    await page.mouse.click(right, middle);
    within(valueOf(await last(page)), 100);
    assert.match(await last(page), /^Length 10\d\.\d mm$|^Length 9\d\.\d mm$/);
    assert.match((await page.textContent("#live")) ?? "", /^Length .* mm$/);
    assert.equal(
      await page.locator(".slice.axial .finding-marks").getAttribute("data-words"),
      `${(await last(page)).replace("Length ", "")}`,
    );
    // A drag sets both ends; the cross stays where it is, and so does the zoom.
    const at = (x: number, y: number): [number, number] => [left + (50 + x) * scale, middle + y * scale];
    await page.mouse.move(...at(-20, 10));
    await page.mouse.down();
    await page.mouse.move(...at(10, 50), { steps: 3 });
    await page.mouse.up();
    within(valueOf(await last(page)), 50);
    assert.equal(await page.locator(".measures li").count(), 2);
    // A hand that trembles sets one point.
    await page.mouse.move(...at(-20, -20));
    await page.mouse.down();
    await page.mouse.move(at(-20, -20)[0] + 2, at(-20, -20)[1] + 1);
    await page.mouse.up();
    assert.equal(await page.locator(".measures li").count(), 2);
    await page.keyboard.press("Escape");
    assert.match(new URL(page.url()).hash, /x=0,0,0/);

    await (await openMenu(page, "ruler")).getByRole("button", { name: "Angle", exact: true }).click();
    for (const place of [at(-30, 0), at(0, 0), at(0, 30)]) await page.mouse.click(...place);
    within(valueOf(await last(page)), 90);

    await (await openMenu(page, "ruler")).getByRole("button", { name: "Area", exact: true }).click();
    const corners = [at(-20, -15), at(20, -15), at(20, 15), at(-20, 15)];
    const [back, finish] = ["Remove the last point", "Finish"].map((name) => page.getByRole("button", { name }));
    assert.ok(back && finish);
    await back.waitFor({ state: "hidden" });
    for (const place of corners) await page.mouse.click(...place);
    // Backspace takes one back, and so does a button; the last one again ends it, or a button.
    for (const takeBack of [() => page.keyboard.press("Backspace"), () => back.click()]) {
      await page.mouse.click(...at(30, 30));
      await takeBack();
    }
    await finish.click();
    await finish.waitFor({ state: "hidden" });
    within(valueOf(await last(page)), 1200);
    await page.locator(".measures li").last().getByRole("button", { name: "Remove" }).click();
    for (const place of corners) await page.mouse.click(...place);
    await page.mouse.click(...at(-20, 15));
    within(valueOf(await last(page)), 1200);
    assert.match(await last(page), /^Area 1,\d+ mm², \d+\.\d mm around$/);
    assert.equal(await page.locator(".measures li").count(), 4);
    await keep(page, "ruler");
    assert.deepEqual(await violations(page), []);

    await page.locator(".measures li").last().getByRole("button", { name: "Keep as a finding" }).click();
    const [one] = await until(
      () => findingsOf(server, head),
      (list) => list.length === 1,
    );
    assert.deepEqual([one?.kind, one?.points_in_patient.length], ["polygon", 4]);
    assert.match(one?.note ?? "", /mm²/);
    // Its name is typed at once; the measure is a finding as long as that one is there.
    await page.waitForSelector(".finding-label:focus");
    assert.ok(
      await page.locator(".measures li").last().getByRole("button", { name: "Kept as a finding" }).isDisabled(),
    );
    await page.waitForSelector(".rows li .row-button");
    assert.match(await page.locator(".row-button").innerText(), /^1\s*Polygon/);
    // It is hidden and shown again, which is of the page alone.
    const words = page.locator(".slice.axial .finding-marks");
    const drawn = async (): Promise<boolean> => {
      const all = (await words.getAttribute("data-words")) ?? "";
      return all.split("\n").includes("1");
    };
    assert.ok(await drawn());
    await page.getByLabel("Shown", { exact: true }).uncheck();
    assert.ok(!(await drawn()));
    await page.getByLabel("Shown", { exact: true }).check();
    assert.ok(await drawn());
    // Undone and done again.
    await page.getByRole("button", { name: "Undo", exact: true }).click();
    await until(
      () => findingsOf(server, head),
      (list) => list.length === 0,
    );
    await page.getByRole("button", { name: "Redo", exact: true }).click();
    assert.equal(
      (
        await until(
          () => findingsOf(server, head),
          (list) => list.length === 1,
        )
      ).length,
      1,
    );

    // A figure of eight has no area; Escape leaves what is begun, then the ruler.
    for (const place of [at(-20, -15), at(20, 15), at(20, -15), at(-20, 15), at(-20, 15)])
      await page.mouse.click(...place);
    assert.match(await last(page), /crosses itself/);
    await page.mouse.click(...at(0, 0));
    await page.keyboard.press("Escape");
    assert.equal(await page.locator("body[data-tool]").count(), 1);
    await page.keyboard.press("Escape");
    assert.equal(await page.locator("body[data-tool]").count(), 0);
    await page.getByRole("button", { name: "Clear the measurements" }).click();
    assert.equal(await page.locator(".measures li").count(), 0);
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("the keyboard alone measures: Enter sets a point at the cross", { skip, timeout: 300_000 }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await page.goto(new URL(`#${head}&l=slices&x=0,0,0`, server.address).href);
  await shown(page);
  await page.waitForSelector(".slice.axial[data-position='0']");
  await page.focus("#surface");
  await page.keyboard.press("k");
  await page.waitForSelector("body[data-tool=length]");
  await page.focus(".slice.sagittal");
  await page.keyboard.press("Enter");
  await page.keyboard.press("PageUp");
  await page.waitForSelector(".slice.sagittal[data-position='10']");
  await page.keyboard.press("Enter");
  assert.equal(await last(page), "Length 10.0 mm");
  // Of the commissures each is asked for by its name.
  await (await openMenu(page, "ruler")).getByRole("button", { name: "AC–PC" }).click();
  const hint = page.getByRole("status");
  await hint.getByText("set the anterior commissure").waitFor();
  await page.focus(".slice.sagittal");
  await page.keyboard.press("Enter");
  await hint.getByText("set the posterior commissure").waitFor();
  assert.deepEqual(troubles, []);
  await context.close();
});

test(
  "on the surface a length is an arc of the ball, and a finding there goes along its radius with the depth",
  { skip, timeout: 300_000 },
  async () => {
    const { page, context, troubles } = await openPage(browser);
    await page.goto(new URL(`#${ball}&r=mesh&d=12`, server.address).href);
    await shown(page);
    // The line that explains the depth goes, and the pane grows.
    await typeDepth(page, 10);
    await page.waitForSelector('#surface[data-depth="10"]');
    await rested(page);
    await page.waitForSelector("canvas.cortex[data-complete=true]");
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    await page.focus("#surface");
    await page.keyboard.press("k");
    await page.waitForSelector("body[data-tool=length]");
    await page.mouse.click(x, y);
    await page.mouse.click(x + 0.22 * box.height, y - 0.1 * box.height);
    const along = await last(page);
    assert.match(along, /^Length \d+\.\d mm along the surface$/);
    const straight = valueOf(await page.locator(".measures li .quiet").innerText());
    // The envelope is the centre of the outermost voxels: about half a voxel within the ball.
    const radius = BALL_MM - 10.5;
    assert.ok(straight > 15, String(straight));
    within(valueOf(along), 2 * radius * Math.asin(straight / 2 / radius));
    // A place beside the ball is none.
    await page.mouse.click(box.x + 30, box.y + 30);
    assert.equal(await page.locator(".measures li").count(), 1);

    await page.locator(".measures li").getByRole("button", { name: "Keep as a finding" }).click();
    const [one] = await until(
      () => findingsOf(server, ball),
      (list) => list.length === 1,
    );
    assert.deepEqual([one?.kind, one?.depth_mm], ["line", 10]);
    await page.getByRole("button", { name: "Clear the measurements" }).click();
    await page.keyboard.press("Escape");
    const marks = page.locator("#surface .overlay:not(.other) .finding-marks");
    // Where its second point is, from the middle of the pane.
    const end = async (): Promise<readonly [number, number]> => {
      const end = (await marks.getAttribute("data-end")) ?? "";
      const [px = NaN, py = NaN] = end.split(",").map(Number);
      return [px - box.width / 2, py - box.height / 2];
    };
    const own = await end();
    assert.equal(await marks.getAttribute("data-away"), "0");
    for (const depth_mm of [20, 3, 10]) {
      await typeDepth(page, depth_mm);
      await page.waitForSelector(`#surface[data-depth="${depth_mm}"]`);
      assert.equal(await marks.getAttribute("data-away"), depth_mm === 10 ? "0" : "1", `${depth_mm} mm`);
      const [px, py] = await end();
      const share = (BALL_MM - 0.5 - depth_mm) / radius;
      const error = Math.hypot(px - share * own[0], py - share * own[1]);
      assert.ok(
        error <= (depth_mm === 10 ? 0.2 : 0.02 * Math.hypot(...own)),
        `${depth_mm} mm: ${px}, ${py} is not ${share} of ${own.join()}`,
      );
    }
    await keep(page, "finding-follows");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);
