// What the page does besides showing: the case and its mask, depths, files, panes, a long list, a phone.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import type { Browser, Download, Page } from "playwright-core";

import {
  type Server,
  type Stage,
  type Watched,
  fragment,
  inSettings,
  keep,
  openMenu,
  openPage,
  readyCase,
  rested,
  shown,
  skip,
  startStage,
  tab,
  typeDepth,
  until,
} from "./support.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let watched: Watched;
let page: Page;
let id: string;
let origin: string;

before(
  async () => {
    if (skip) return;
    stage = await startStage("demo");
    ({ server, browser } = stage);
    id = await readyCase(server.address);
    watched = await openPage(browser, { permissions: ["clipboard-read", "clipboard-write"] });
    page = watched.page;
    origin = `${new URL(server.address).origin}/?renderer=server`;
    await page.goto(`${origin}#${id}`);
    await shown(page);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

const group = (title: string): ReturnType<Page["locator"]> =>
  page.locator(".panel .group", { has: page.locator("summary", { hasText: title }) });

/** Opens a section of a tab of the panel. */
async function unfold(title: string, on: Parameters<typeof tab>[1]): Promise<ReturnType<Page["locator"]>> {
  await tab(page, on);
  const section = group(title);
  if ((await section.getAttribute("open")) === null) await section.locator("summary").first().click();
  return section;
}

/** Shows what an address says of the case, and nothing that was shown before. */
async function open(rest = ""): Promise<void> {
  await page.goto("about:blank");
  await page.goto(`${origin}#${id}${rest}`);
  await shown(page);
  await rested(page);
  await tab(page, "read");
}

async function download(click: () => Promise<void>): Promise<{ name: string; bytes: Buffer }> {
  const waiting: Promise<Download> = page.waitForEvent("download");
  await click();
  const saved = await waiting;
  return { name: saved.suggestedFilename(), bytes: await readFile(await saved.path()) };
}

const title = (half = 0): Promise<string | null> => page.locator("#surface .pane-title").nth(half).textContent();

test(
  "the depth slider is explained once, marked from 6 to 20 mm, and half of it is the first 25 mm",
  { skip },
  async () => {
    const line = page.locator(".first-time");
    assert.match(await line.innerText(), /0 mm is just below the dura/);
    await line.locator("button").click();
    await line.waitFor({ state: "detached" });
    await open();
    assert.equal(await line.count(), 0, "it is not explained again");
    const slider = await page.locator("#depth").boundingBox();
    const band = await page.locator(".good-depths").boundingBox();
    assert.ok(slider && band);
    const thumb = 16;
    const share = (x: number): number => (x - slider.x - thumb / 2) / (slider.width - thumb);
    assert.ok(Math.abs(share(band.x) - 6 / 50) < 0.01 && Math.abs(share(band.x + band.width) - 20 / 50) < 0.01);
    await page.mouse.click(slider.x + slider.width / 2, slider.y + slider.height / 2);
    const depth = async (): Promise<number> => Number(await page.locator("#depth-number").inputValue());
    assert.ok(Math.abs((await depth()) - 25) <= 0.5, String(await depth()));
    await page.keyboard.press("ArrowLeft");
    assert.equal(await until(depth, (now) => now === 24.5), 24.5);
    assert.equal(await page.locator("#depth").getAttribute("aria-valuetext"), "24.5 mm");
    await page.keyboard.press("PageDown");
    assert.equal(await until(depth, (now) => now === 29.5), 29.5, "as on the picture, it goes deeper");
    // The box follows although it has the focus, but not while something is typed.
    await page.locator("#depth-number").focus();
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    await page.mouse.move(box.x + 50, box.y + 200);
    await page.keyboard.down("Alt");
    await page.mouse.wheel(0, 120);
    await page.keyboard.up("Alt");
    assert.equal(await until(depth, (now) => now === 30), 30);
    // Whoever changes the depth has understood: the line is not there the next time, and no picture moves now.
    const other = await openPage(browser);
    await other.page.goto(`${origin}#${id}`);
    await shown(other.page);
    await other.page.locator(".first-time").waitFor();
    const before = await other.page.locator("#surface").boundingBox();
    await other.page.keyboard.press("]");
    await rested(other.page);
    assert.deepEqual(await other.page.locator("#surface").boundingBox(), before);
    await other.page.reload();
    await shown(other.page);
    assert.equal(await other.page.locator(".first-time").count(), 0);
    await other.context.close();
  },
);

test("near the envelope intensities are averaged, which is said and can be switched off", { skip }, async () => {
  await open("&d=0.5");
  assert.equal(await title(), "0.5 mm, mean of 1.0 mm  Left");
  await unfold("Drawing", "images");
  const asked = page.waitForRequest((request) => /render\?depth_mm=0\.5&/.test(request.url()));
  await page.locator("#averages").uncheck();
  assert.doesNotMatch((await asked).url(), /slab_mm/);
  await page.waitForFunction(() => document.querySelector(".pane-title")?.textContent === "0.5 mm  Left");
  assert.equal((await fragment(page)).g, "0");
  const again = page.waitForRequest((request) => /render\?depth_mm=0\.5&/.test(request.url()));
  await page.locator("#averages").check();
  assert.match((await again).url(), /slab_mm=0\.5&/);
  await typeDepth(page, 10);
  await page.waitForFunction(() => document.querySelector(".pane-title")?.textContent === "10.0 mm  Left");
});

test(
  "mirror and slices are shown together: the mirrored point is in them, and several outlines with their depths",
  { skip, timeout: 600_000 },
  async () => {
    await open("&l=both&x=40,20,30");
    await page.waitForFunction(() => document.querySelectorAll(".slice-image > *").length === 3);
    await page.waitForSelector("#surface.halved");
    const twin = (plane: string): ReturnType<Page["locator"]> => page.locator(`.slice.${plane} .cursor.ghost line`);
    for (const plane of ["axial", "coronal"]) {
      const [own, other] = [
        await page.locator(`.slice.${plane} .cursor.mark line`).first().getAttribute("x1"),
        await twin(plane).nth(2).getAttribute("x1"),
      ];
      const middle = (await page.locator(`.slice.${plane} .slice-view`).boundingBox())?.width ?? 0;
      // The patient's left is at the right of a radiological slice; its mirror image at the left.
      assert.ok(Number(other) < middle / 2 - 5, `${plane}: ${other} of ${middle}, the point at ${own}`);
    }
    assert.equal(await twin("sagittal").count(), 0, "it is on the other side of the head");
    const asked = page.waitForRequest((request) => /slices\/axial.*depth_mm=10%2C0%2C20/.test(request.url()));
    await inSettings(page, async () => {
      await page.locator("#outlines").fill("20, 0, 20");
      await page.locator("#outlines").press("Tab");
    });
    await asked;
    // The legend comes with its picture.
    const legend = await until(
      () => page.locator(".slice.axial .outlines span").allInnerTexts(),
      ({ length }) => length > 1,
    );
    assert.deepEqual(legend, ["10 mm", "0 mm", "20 mm"]);
    assert.equal((await fragment(page)).o, "0,20");
    await page.locator("#surface").focus();
    await page.keyboard.press("o");
    assert.equal(await page.locator(".slice.axial .outlines").isVisible(), false);
    await page.keyboard.press("o");
    await keep(page, "both");
  },
);

test(
  "the case's section tells of its mask, outlines it, saves it and makes versions",
  { skip, timeout: 600_000 },
  async () => {
    await open("&l=slices&x=20,20,30");
    const section = await unfold("Case and mask", "case");
    await section.locator(".case-facts dt").first().waitFor();
    const facts = await section.locator(".case-facts").innerText();
    assert.match(facts, /Mask\s+as supplied, [\d,.]+ ml/);
    assert.match(facts, /Closing radius\s+10\.0 mm/);
    assert.match(facts, /Verdict\s+\S/);
    assert.match(facts, /Volume\s+\d+ × \d+ × \d+, [\d.]+ mm/);
    await section.locator("#mask-outline").check();
    const outline = page.locator(".slice.axial .mask-outline path");
    await outline.waitFor({ state: "attached" });
    const [path, slice] = [await outline.boundingBox(), await page.locator(".slice.axial .slice-view").boundingBox()];
    assert.ok(path && slice && path.width > slice.width / 3 && path.height > slice.height / 3);
    // The mask lies within its envelope, whose outline is that of depth 0; both are in the middle of the slice.
    assert.ok(path.x > slice.x && path.x + path.width < slice.x + slice.width);
    await keep(page, "mask-outline");
    await section.locator("#mask-outline").uncheck();
    await outline.waitFor({ state: "detached" });
    const mask = await download(() => section.getByRole("button", { name: "Save the mask" }).click());
    assert.equal(mask.name, `isocortex-${id.slice(0, 8)}-mask.nii.gz`);
    assert.equal(mask.bytes.readUInt16BE(0), 0x1f8b, "it is packed");
    // What the page unpacks for the outline is what it saves.
    await section.locator("#version-offset").fill("1");
    const answered = page.waitForResponse((response) => response.request().method() === "PUT");
    await section.getByRole("button", { name: "Make the version" }).click();
    const answer = await answered;
    assert.match(answer.url(), /closing_radius_mm=10&offset_mm=1$/);
    const version = (await answer.json()) as { id: string; previous: string };
    assert.equal(version.previous, id);
    const row = page.locator(`#case-list [data-id="${version.id}"]`);
    await row.locator(".fresh-badge", { hasText: "New" }).waitFor();
    assert.ok(page.url().includes(id), "the case that is read stays");
    await section.locator("#version-offset").fill("0");
    await section.getByRole("button", { name: "Make the version" }).click();
    await page.waitForFunction(() =>
      /already has this mask and radius/.test(document.querySelector(".panel")?.textContent ?? ""),
    );
    await row.and(page.locator("[data-state=ready]")).waitFor();
    await row.locator(".thumb img").waitFor();
    await fetch(new URL(`v1/cases/${version.id}`, server.address), { method: "DELETE" });
    await row.waitFor({ state: "detached" });
  },
);

/** The size of a PNG. */
const sizeOf = (png: Buffer): readonly [number, number] => [png.readUInt32BE(16), png.readUInt32BE(20)];

test("pictures are saved in several sizes with a caption, and copied", { skip, timeout: 600_000 }, async () => {
  await open("&l=slices&x=20,20,30");
  await page.waitForFunction(() => document.querySelectorAll(".slice-image > *").length === 3);
  const section = await openMenu(page, "export");
  const panes = await page.locator(".panes").boundingBox();
  assert.ok(panes);
  for (const times of [1, 2]) {
    await section.locator("#times").selectOption(String(times));
    const { name, bytes } = await download(() => section.getByRole("button", { name: "Save picture" }).click());
    assert.equal(name, `isocortex-${id.slice(0, 8)}-10.0mm.png`);
    const [width, height] = sizeOf(bytes);
    assert.ok(Math.abs(width - panes.width * times) <= times, `${width}`);
    // Case, how it is seen, program and notice stand below the picture.
    assert.ok(height >= (panes.height + 3 * 17) * times && height <= (panes.height + 150) * times, `${height}`);
    await page.waitForFunction(() =>
      /The picture was saved/.test(document.querySelector("#menu-export")?.textContent ?? ""),
    );
  }
  await section.locator("#times").selectOption("1");
  await page.bringToFront();
  await section.getByRole("button", { name: "Copy picture" }).click();
  await page.waitForFunction(() =>
    /The picture was copied/.test(document.querySelector("#menu-export")?.textContent ?? ""),
  );
  const types = await page.evaluate(async () => (await navigator.clipboard.read()).flatMap((item) => item.types));
  assert.deepEqual(types, ["image/png"]);
});

test(
  "the profile is read by the pointer, goes to a depth, and is saved as picture and table",
  { skip, timeout: 600_000 },
  async () => {
    await open("&x=40,20,30");
    const chart = page.locator("svg.chart");
    await chart.waitFor();
    // One that is drawn again at this moment has no place.
    const box = await until(
      () => chart.boundingBox(),
      (found) => found !== null,
    );
    assert.ok(box);
    // Its axis goes from 40 to 260 of 268, for 0 to 30 mm.
    const at = (depth_mm: number): { x: number; y: number } => ({
      x: ((40 + (220 * depth_mm) / 30) / 268) * box.width,
      y: box.height / 2,
    });
    // The chart is drawn again when the server has measured at the point.
    const wanted = /^1[45]\.\d\d mm: [\d.,]+, mirrored [\d.,]+$/;
    const read = await until(
      async () => {
        await chart.hover({ position: at(15) });
        return page.locator(".profile-read").innerText();
      },
      (now) => wanted.test(now),
    );
    assert.match(read, wanted);
    await chart.click({ position: at(15) });
    await page.waitForFunction(() => Number(document.querySelector<HTMLElement>("#surface")?.dataset.depth) > 14);
    assert.ok(Math.abs(Number((await fragment(page)).d) - 15) < 0.5);
    await page.locator(".as-table > summary").click();
    const table = await download(() => page.getByRole("button", { name: "Save as CSV" }).click());
    assert.equal(table.name, `isocortex-${id.slice(0, 8)}-profile.csv`);
    const [head, ...rows] = table.bytes.toString().trim().split("\r\n");
    assert.equal(head, "depth_mm,intensity,mirrored_intensity,case,view,program");
    assert.match(
      rows[3] ?? "",
      new RegExp(`,"[^"]* · ${id.slice(0, 8)}","[^"]*Point [LR]\\s[^"]*mm","Isocortex [^"]*"$`),
    );
    assert.ok(rows.length > 60 && rows.every((row, index) => Number(row.split(",")[0]) === index / 4), rows[3]);
    const picture = await download(() => page.getByRole("button", { name: "Save as picture" }).click());
    assert.ok(sizeOf(picture.bytes)[0] > 900 && picture.bytes.length > 10_000);
  },
);

test(
  "a sheet, a turn and a sweep are drawn by the server, each naming the case",
  { skip, timeout: 600_000 },
  async () => {
    await open();
    await inSettings(page, async () => {
      await page.locator("#sweep-from").fill("12");
      await page.locator("#sweep-to").fill("9.5");
      await page.locator("#sweep-to").press("Tab");
      assert.equal(await page.locator("#sweep-from").inputValue(), "9.5", "its ends are put in order");
      await page.locator("#sweep-speed").selectOption("20");
    });
    const section = await openMenu(page, "export");
    await section.getByRole("button", { name: "Sheet, turn or sweep" }).click();
    const dialog = page.locator("dialog.series");
    await dialog.locator("#series-depths").fill("7, 900");
    await dialog.getByRole("button", { name: "Draw and save" }).click();
    assert.match(await dialog.locator("[role=status]").innerText(), /from 0 to/);
    await dialog.locator("#series-depths").fill("7");
    const sheet = await download(() => dialog.getByRole("button", { name: "Draw and save" }).click());
    assert.equal(sheet.name, `isocortex-${id.slice(0, 8)}-sheet.png`);
    assert.ok(sizeOf(sheet.bytes)[0] >= 6 * 320);
    await dialog.locator("#series-kind").selectOption("sweep");
    const asked = page.waitForRequest((request) => request.method() === "POST");
    const film = await download(() => dialog.getByRole("button", { name: "Draw and save" }).click());
    const body = (await asked).postDataJSON() as { sweep: Record<string, unknown> & { render: { annotate: boolean } } };
    assert.deepEqual(
      [body.sweep.from_mm, body.sweep.to_mm, body.sweep.frames, body.sweep.delay_ms, body.sweep.there_and_back],
      [9.5, 12, 6, 25, true],
    );
    assert.equal(body.sweep.render.annotate, true);
    assert.ok(film.bytes.includes("acTL"), "it is animated");
    await page.keyboard.press("Escape");
    // The same range is played on the page.
    await page.locator(".play").click();
    const depths = new Set<number>();
    await until(
      async () => depths.add(Number(await page.locator("#depth-number").inputValue())).size,
      (count) => count >= 4,
    );
    await page.locator(".play").click();
    assert.ok(
      [...depths].every((depth) => depth >= 9.5 && depth <= 12),
      [...depths].join(),
    );
  },
);

test("the panels fold, and the page fills the screen", { skip }, async () => {
  await open();
  const width = async (): Promise<number> => (await page.locator("#surface").boundingBox())?.width ?? 0;
  const before = await width();
  await page.getByRole("button", { name: "Controls" }).click();
  await page.waitForSelector(".panel", { state: "hidden" });
  await page.getByRole("button", { name: "List of cases" }).click();
  await page.waitForSelector("#sidebar", { state: "hidden" });
  assert.ok((await width()) > before + 400, `${before} and ${await width()}`);
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 1440);
  await page.getByRole("button", { name: "Full screen" }).click();
  await page.waitForFunction(() => document.fullscreenElement !== null);
  await page.getByRole("button", { name: "Full screen" }).click();
  await page.waitForFunction(() => document.fullscreenElement === null);
  await page.getByRole("button", { name: "Controls" }).click();
  await page.getByRole("button", { name: "List of cases" }).click();
  await page.waitForSelector(".panel");
  assert.ok(Math.abs((await width()) - before) < 1);
});

/** A thousand cases that wait, the newest of which is the server's own. */
async function thousand(other: Page): Promise<readonly number[]> {
  const asked: number[] = [];
  const own = (await (await fetch(new URL(`v1/cases/${id}`, server.address))).json()) as { id: string; state: string };
  const cases = Array.from({ length: 1000 }, (_, index) => ({
    ...own,
    id: index === 0 ? id : index.toString(16).padStart(32, "0"),
    status: "new",
    finding_count: 0,
    name: index === 0 ? "Demo" : `Head ${String(index).padStart(4, "0")}`,
    created_at: new Date(Date.UTC(2026, 0, 1) - index * 3_600_000).toISOString(),
  }));
  await other.route("**/v1/cases/search", (route) => {
    const {
      skip,
      limit,
      sort,
      text = "",
    } = route.request().postDataJSON() as {
      readonly skip: number;
      readonly limit: number;
      readonly sort: string;
      readonly text?: string;
    };
    asked.push(skip);
    const found = cases.filter(({ name }) => name.toLowerCase().includes(text.toLowerCase()));
    if (sort === "oldest") found.reverse();
    return route.fulfill({ json: { cases: found.slice(skip, skip + limit), total: found.length } });
  });
  await other.route(/\/v1\/cases\/0[0-9a-f]{31}\//, (route) => route.abort());
  return asked;
}

test(
  "a thousand cases are scrolled, sorted, searched and walked through; few rows are there",
  { skip, timeout: 600_000 },
  async () => {
    const { page: other, context } = await openPage(browser);
    const asked = await thousand(other);
    await other.goto(`${origin}#${id}`);
    await shown(other);
    const rows = other.locator("#case-list [data-id]");
    await other.waitForSelector('.case-table[aria-rowcount="1001"]');
    assert.ok((await rows.count()) < 60, String(await rows.count()));
    for (const row of await rows.all()) assert.ok(((await row.boundingBox())?.height ?? 99) <= 56);
    const scroller = other.locator(".case-scroller");
    const begun = Date.now();
    await scroller.evaluate((box) => (box.scrollTop = box.scrollHeight));
    await rows.filter({ hasText: "Head 0999" }).waitFor();
    console.log(`to the last of 1,000 rows: ${Date.now() - begun} ms`);
    assert.ok((await rows.count()) < 60);
    // The pages between were never in sight.
    assert.ok(!asked.some((skip) => skip > 100 && skip < 850), asked.join());
    await keep(other, "thousand-cases");
    await rows.locator("a", { hasText: "Head 0999" }).focus();
    const focused = (words: RegExp): Promise<string> =>
      until(
        () => other.evaluate(() => document.activeElement?.textContent ?? ""),
        (text) => words.test(text),
      );
    await other.keyboard.press("ArrowUp");
    await focused(/Head 0998/);
    await other.keyboard.press("Home");
    await focused(/Demo/);
    for (let press = 0; press < 30; press += 1) await other.keyboard.press("ArrowDown");
    await focused(/Head 0030/);
    await other.locator("#case-order").selectOption("oldest");
    await rows.filter({ hasText: "Head 0999" }).waitFor();
    await other.locator("#case-search").fill("head 0777");
    await other.waitForFunction(() => document.querySelectorAll("#case-list [data-id]").length === 1);
    assert.match(await rows.first().innerText(), /Head 0777/);
    // Keys are the picture's once a case is opened: in the list, Enter would open another patient.
    await other.goto(`${origin}#${"0".repeat(31)}`);
    await other.waitForSelector(".viewer", { state: "detached" });
    await other.locator("#case-search").fill("Demo");
    await other.locator("#case-list a", { hasText: "Demo" }).focus();
    await other.keyboard.press("Enter");
    await other.waitForSelector("#surface:focus");
    await context.close();
  },
);

test(
  "on a phone the depth is always in reach, and everything is large enough for a finger",
  { skip, timeout: 600_000 },
  async () => {
    const phone = await openPage(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
    // Nothing is wider than the screen while the volume is on its way either, in any language.
    let release = (): void => {};
    const held = new Promise<void>((resolve) => (release = resolve));
    await phone.page.route(/\/volume\?/, async (route) => {
      await held;
      await route.continue();
    });
    await phone.page.goto(`${origin}#${id}`);
    await phone.page.locator(".loading-line").waitFor();
    assert.equal(await phone.page.evaluate(() => document.documentElement.scrollWidth), 390);
    release();
    await shown(phone.page);
    for (const place of [0, 400, 99_999]) {
      await phone.page.locator(".page").evaluate((one, top) => one.scrollTo(0, top), place);
      const bar = await phone.page.locator(".depth-bar").boundingBox();
      assert.ok(bar && bar.y >= 0 && bar.y + bar.height <= 844.5, `${place}: ${JSON.stringify(bar)}`);
    }
    assert.equal(await phone.page.evaluate(() => document.documentElement.scrollWidth), 390);
    for (const layout of ["slices", "single"]) {
      await phone.page.locator(`.layouts button[value=${layout}]`).click();
      await phone.page.waitForSelector(`body[data-layout=${layout}]`);
      const small = await phone.page.evaluate(() => {
        const all = document.querySelectorAll<HTMLElement>(
          "button, select, summary, input:not([type=file]), .file-button",
        );
        return [...all].flatMap((one) => {
          // A check box is as large as its label.
          const target = one.matches("[type=checkbox]") ? (one.closest("label") ?? one) : one;
          const { width, height } = target.getBoundingClientRect();
          const is_small = target.checkVisibility() && (width < 40 || height < 40);
          return is_small ? [`${target.outerHTML.slice(0, 80)}: ${width} × ${height}`] : [];
        });
      });
      assert.deepEqual(small, [], layout);
    }
    await keep(phone.page, "phone");
    assert.deepEqual(phone.troubles, []);
    await phone.context.close();
  },
);

test("on a phone a finger scrolls past slices, and marks a point where it taps", { skip }, async () => {
  const phone = await openPage(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  const { page: small, context } = phone;
  await small.goto(`${origin}#${id}&l=slices`);
  await shown(small);
  await small.waitForSelector(".slice.coronal[data-position]");
  const session = await context.newCDPSession(small);
  const box = await small.locator(".slice.axial").boundingBox();
  assert.ok(box);
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 3];
  const touch = (type: "touchStart" | "touchMove" | "touchEnd", ...ys: number[]): Promise<unknown> =>
    session.send("Input.dispatchTouchEvent", { type, touchPoints: ys.map((at) => ({ x, y: at })) });
  await touch("touchStart", y);
  for (const up of [20, 60, 120, 200]) await touch("touchMove", y - up);
  await touch("touchEnd");
  const scroller = small.locator(".page");
  const scrolled = (): Promise<number> => scroller.evaluate((one) => one.scrollTop);
  assert.ok((await until(scrolled, (top) => top > 100)) > 100, "the page is scrolled");
  assert.equal((await fragment(small)).x, undefined, "nothing is marked");
  // What the finger has thrown rolls on for a while.
  const scrolledBack = (): Promise<number> =>
    scroller.evaluate((one) => {
      one.scrollTo(0, 0);
      return new Promise((resolve) => setTimeout(() => resolve(one.scrollTop), 200));
    });
  assert.equal(await until(scrolledBack, (top) => top === 0), 0);
  await small.touchscreen.tap(x, y);
  const marked = async (): Promise<string | undefined> => (await fragment(small)).x;
  assert.ok(await until(marked, (place) => place !== undefined), "a point is marked");
  assert.deepEqual(phone.troubles, []);
  await context.close();
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(watched.troubles, []);
});
