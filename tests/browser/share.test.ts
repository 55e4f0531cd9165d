// A case as one file: opened from a disk, without a network, it shows what the page shows.

import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";

import type { Browser, BrowserContextOptions, Page } from "playwright-core";

import { brainMask, markedVolume } from "./phantom.ts";
import { bare, canvasSize, picturesAgree, show } from "./pixels.ts";
import {
  type Server,
  type Stage,
  brightest,
  fragment,
  keep,
  openMenu,
  openPage,
  readyCase,
  shown,
  skip,
  startStage,
  typeDepth,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

const MOST_BYTES = 12_000_000;

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;

before(
  async () => {
    if (skip) return;
    stage = await startStage("demo");
    ({ server, browser } = stage);
    id = await readyCase(server.address);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

/** Waits until the maps of a case are there: the words of the report are about them, too. */
async function mapped(case_id: string): Promise<void> {
  const ask = async (): Promise<string> => {
    const answer = await fetch(new URL(`v1/cases/${case_id}`, server.address));
    return ((await answer.json()) as { readonly maps: { readonly state: string } }).maps.state;
  };
  await until(ask, (state) => state !== "making", 480);
}

interface OpenedFile {
  readonly page: Page;
  readonly troubles: string[];
  /** All that the page has asked for but the file. */
  readonly requests: string[];
  close(): Promise<void>;
}

/** Opens a file from the disk, without a network, and waits for its picture. */
async function openFile(file: string, hash = "", options: BrowserContextOptions = {}): Promise<OpenedFile> {
  const { page, troubles, context } = await openPage(browser, { ...options, offline: true });
  const requests: string[] = [];
  const address = pathToFileURL(file).href;
  page.on("request", (request) => {
    if (request.url().split("#")[0] !== address) requests.push(request.url());
  });
  await page.goto(`${address}${hash}`);
  await shown(page);
  return { page, troubles, requests, close: () => context.close() };
}

/** Stores a finding on the left, at the depth of a cut. */
async function markLeft(address: string): Promise<void> {
  const path = new URL(`v1/cases/${id}/findings`, address);
  const { center_in_patient: [x, y, z] = [0, 0, 0] } = (
    (await (await fetch(new URL(`v1/cases/${id}`, address))).json()) as {
      envelope_sphere: { center_in_patient: [number, number, number] };
    }
  ).envelope_sphere;
  const etag = (await fetch(path)).headers.get("etag") ?? "";
  const finding = {
    id: "a",
    kind: "point",
    points_in_patient: [[x + 45, y, z + 20]],
    depth_mm: 12,
    label: "blurred",
    note: "Seen at the bottom of the sulcus.",
    is_dismissed: false,
  };
  const body = JSON.stringify({ findings: [finding] });
  const stored = await fetch(path, { method: "PUT", headers: { "if-match": etag }, body });
  assert.equal(stored.status, 200, await stored.text());
}

/** Saves the demo's head by the button of the page. */
async function saveByButton(page: Page, folder: string): Promise<string> {
  const menu = await openMenu(page, "export");
  const download = page.waitForEvent("download");
  await menu.getByRole("button", { name: "Save as one file to hand on" }).click();
  const file = path.join(folder, (await download).suggestedFilename());
  await (await download).saveAs(file);
  await menu.getByText("The file was saved.").waitFor();
  return file;
}

/** The size of the surface's pane. */
const paneOf = (page: Page): Promise<readonly [number, number]> =>
  page.locator("#surface").evaluate(({ clientWidth, clientHeight }) => [clientWidth, clientHeight] as const);

/** The pixels of the surface's canvas, as a data URL. */
async function pixelsOf(page: Page): Promise<string> {
  const clip = await page.locator("canvas.cortex").evaluate((canvas: HTMLCanvasElement) => {
    const { left, top } = canvas.getBoundingClientRect();
    return { x: Math.round(left), y: Math.round(top), width: canvas.width, height: canvas.height };
  });
  return `data:image/png;base64,${(await page.screenshot({ clip })).toString("base64")}`;
}

test(
  "the file that the button saves shows the pixels of the page, asks nobody for anything, and can be turned and peeled",
  { skip, timeout: 600_000 },
  async () => {
    await mapped(id);
    await markLeft(server.address);
    const { page, troubles, context } = await openPage(browser, { viewport: { width: 1000, height: 800 } });
    await page.goto(`${new URL("/", server.address)}#${id}&r=exact&l=single`);
    await shown(page);
    const file = await saveByButton(page, stage?.folder ?? "");
    const bytes = await readFile(file);
    console.log(`the file of the demo's head: ${bytes.length} bytes`);
    assert.ok(bytes.length <= MOST_BYTES, String(bytes.length));

    // The pane of the page and that of the file are made equally large.
    const opened = await openFile(file, "", { viewport: { width: 1000, height: 800 } });
    await until(
      () => fragment(opened.page),
      ({ x }) => x !== undefined,
    );
    for (const one of [page, opened.page]) {
      await one.locator(".first-time button").click();
      await one.waitForSelector(".first-time", { state: "detached" });
    }
    for (const one of [page, opened.page]) await show(one, `#${id}&r=exact&v=right&d=8`, "exact");
    const [[width, height], [own_width, own_height]] = [await paneOf(page), await paneOf(opened.page)];
    await opened.page.setViewportSize({ width: 1000 + width - own_width, height: 800 + height - own_height });
    assert.deepEqual(await paneOf(opened.page), await paneOf(page));
    await bare(page);
    await bare(opened.page);
    for (const [view, depth_mm] of [
      ["left", 8],
      ["superior", 20],
      ["anterior", 0],
    ] as const) {
      const state = `#${id}&r=exact&v=${view}&d=${depth_mm}`;
      await show(page, state, "exact");
      await show(opened.page, state, "exact");
      assert.deepEqual(await canvasSize(opened.page), await canvasSize(page));
      const share = await picturesAgree(page, await pixelsOf(page), await pixelsOf(opened.page));
      console.log(`${view}, ${depth_mm} mm: ${(100 * share).toFixed(3)} % of the pixels within 4/255 of the page's`);
      assert.equal(share, 1, `${view}, ${depth_mm} mm`);
    }
    await bare(opened.page, false);

    // A hand turns it, the box takes a depth, and Back goes back.
    await show(opened.page, `#${id}&v=left&d=8`, "exact");
    const box = await opened.page.locator("canvas.cortex").boundingBox();
    assert.ok(box);
    await opened.page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await opened.page.mouse.down();
    await opened.page.mouse.move(box.x + box.width / 2 + 80, box.y + box.height / 2 + 30, { steps: 4 });
    await opened.page.mouse.up();
    await typeDepth(opened.page, 15);
    const turned = await fragment(opened.page);
    assert.equal(turned.d, "15");
    assert.ok(turned.q, JSON.stringify(turned));

    // What stands beside it.
    const { page: held } = opened;
    assert.match(await held.locator(".research").innerText(), /Not for diagnosis/);
    const row = held.locator(".findings .rows > li");
    assert.match(await row.innerText(), /Left[\s\S]*12.0 mm[\s\S]*blurred[\s\S]*Seen at the bottom/);
    assert.match(await held.locator(".report").innerText(), /Conclusion[\s\S]*blurred/);
    await row.locator("button").click();
    assert.ok((await fragment(held)).x, "the finding leads to its place");
    // The halves are there, too, and the slices are drawn here.
    await held.locator("details:has(.surfaces) > summary").click();
    await held.locator(".surfaces button[value=left]").click();
    await held.waitForSelector("#surface[data-surface=left][data-drawn=true]");
    await held.locator(".layouts button[value=both]").click();
    await held.waitForSelector(".slice.axial[data-way=page]");
    await held.waitForSelector(".slice.sagittal[data-way=page]");
    await keep(held, "share");
    assert.deepEqual([...troubles, ...opened.troubles], []);
    assert.deepEqual(opened.requests, []);
    await opened.close();
    await context.close();
  },
);

test("left is left in the file, on the surface and in the slices", { skip, timeout: 300_000 }, async () => {
  const marked = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
  await mapped(marked);
  const file = path.join(stage?.folder ?? "", "marked.html");
  const answer = await fetch(new URL(`v1/cases/${marked}/share?language=pt-BR`, server.address));
  assert.equal(answer.status, 200, answer.ok ? "" : await answer.text());
  await writeFile(file, new Uint8Array(await answer.arrayBuffer()));
  // A window in which the ball alone is white, and no light.
  const ball = `#${marked}&d=9&w=700,300&a=1`;
  const { page, troubles, requests, close } = await openFile(file, `${ball}&v=anterior`);
  assert.equal(await page.locator("html").getAttribute("lang"), "pt-BR");
  const placeIn = async (selector: string) => brightest(page, await page.locator(selector).screenshot(), 250);
  for (const [view, is_right_at_left] of [
    ["anterior", true],
    ["superior", false],
  ] as const) {
    await show(page, `${ball}&v=${view}`, "exact");
    await bare(page);
    const found = await placeIn("#surface > .surface-host");
    assert.ok(found && found.count > 100, `${view}: ${JSON.stringify(found)}`);
    assert.ok(is_right_at_left ? found.x < 0.45 : found.x > 0.55, `${view}: ${found.x}`);
    await bare(page, false);
  }
  await show(page, `${ball}&v=left&l=mirror`, "exact");
  await bare(page);
  const mirrored = await placeIn("#surface > .surface-host");
  assert.ok(mirrored && mirrored.count > 100 && mirrored.least_x > 0.5, JSON.stringify(mirrored));
  await bare(page, false);
  // The slices are radiological: the patient's right is at their left.
  await show(page, `${ball}&v=right&x=-38,0,0&l=slices`, "exact");
  for (const plane of ["axial", "coronal"]) {
    await page.waitForSelector(`.slice.${plane}[data-way=page][data-position="0"]`);
    const found = await until(
      () => placeIn(`.slice.${plane} .slice-image`),
      (one) => (one?.count ?? 0) > 100,
    );
    assert.ok(found && found.x < 0.45, `${plane}: ${JSON.stringify(found)}`);
  }
  await keep(page, "share-left");
  assert.deepEqual(troubles, []);
  assert.deepEqual(requests, []);
  await close();
  // Of an address with what only a server has, the file shows what it has, and complains of nothing.
  const layer = "0".repeat(32);
  const asked = `#${marked}&y=${layer}&w=0.5,0.1&S=1&Sb=${layer}&n=axial&e=0.5&h=1&l=slices`;
  const other = await openFile(file, asked);
  assert.deepEqual(await fragment(other.page), { id: marked, l: "slices" });
  assert.equal(await other.page.locator(".notice-line.bad[role=alert]:visible").count(), 0);
  assert.deepEqual([other.troubles, other.requests], [[], []]);
  await other.close();
});
