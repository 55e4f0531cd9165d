// The list of cases, from upload to deletion, and what goes wrong on the way. The server draws here as well.

import assert from "node:assert/strict";
import { writeFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { brainMask, markedVolume } from "./phantom.ts";
import {
  type Server, type Watched, brightest, headOfDemo, keep, launchBrowser, openPage, readyCase, scratchFolder, shown, skip, startServer, upload,
} from "./support.ts";

let scratch: Awaited<ReturnType<typeof scratchFolder>>;
let server: Server;
let browser: Browser;
let watched: Watched;
let page: Page;
let origin: string;

before(async () => {
  if (skip) return;
  scratch = await scratchFolder();
  server = await startServer({ command: "serve", data: path.join(scratch.folder, "data") });
  browser = await launchBrowser();
  watched = await openPage(browser);
  page = watched.page;
  origin = new URL(server.address).origin;
  await page.goto(`${origin}/?renderer=server`);
}, { timeout: 120_000 });

after(async () => {
  await browser?.close();
  await server?.stop();
  await scratch?.clean();
});

const row = (state: string): string => `#case-list [data-state=${state}]`;

/** Drops files on the page, as a hand does. */
async function drop(files: readonly { name: string; bytes: Buffer }[]): Promise<void> {
  const packed = files.map(({ name, bytes }) => [name, bytes.toString("base64")] as const);
  await page.evaluate((all) => {
    const transfer = new DataTransfer();
    for (const [name, base64] of all) transfer.items.add(new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name));
    for (const type of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(type, { dataTransfer: transfer, bubbles: true, cancelable: true }));
  }, packed);
}

test("an empty server asks for a case; a file that is no volume is refused in words", { skip }, async () => {
  await page.waitForSelector("#add[open]");
  assert.match(await page.locator("#cases-note").innerText(), /None yet/);
  const file = path.join(scratch.folder, "DOE-JANE.nii");
  await writeFile(file, "this is no NIfTI file");
  await page.locator("#upload-volume").setInputFiles(file);
  await page.locator("#upload button[type=submit]").click();
  await page.waitForFunction(() => (document.querySelector("#upload-note")?.textContent ?? "") !== "");
  const words = await page.locator("#upload-note").innerText();
  assert.match(words, /nifti/i);
  assert.doesNotMatch(words, /DOE|status \d/, "neither the file's name nor a bare status");
});

test("a volume and its mask that are dropped become a case, which is shown when it is ready", { skip }, async () => {
  let sent = "";
  page.on("request", (request) => {
    if (request.method() === "POST") sent = request.postData() ?? "";
  });
  await drop([{ name: "DOE-JANE-mask.nii", bytes: brainMask() }, { name: "DOE-JANE.nii", bytes: markedVolume() }]);
  assert.match(await page.locator(".chosen").innerText(), /Volume, 0\.6 MB · mask, 0\.6 MB/);
  await page.locator("#upload-name").fill("Marked");
  await page.locator("#upload button[type=submit]").click();
  await page.waitForSelector(row("ready"), { timeout: 60_000 });
  await shown(page);
  assert.doesNotMatch(sent, /DOE/, "the files' names stay here");
  assert.equal(await page.locator("#case-title").innerText(), "Marked");
  assert.doesNotMatch(page.url(), /Marked/);
  await page.waitForSelector(`${row("ready")} .thumb img`);
});

test("a doubtful mask is said before the picture, with its reasons", { skip }, async () => {
  // The phantom's brain is too small for a brain.
  assert.match(await page.locator(".quality").innerText(), /Check the mask[\s\S]* ml/);
  assert.equal(await page.locator(`${row("ready")} .quality-badge`).innerText(), "Check the mask");
  await page.locator(".quality button").click();
  await page.waitForSelector("dialog.mask img");
  await page.keyboard.press("Escape");
});

test("a mark on the patient's right is on the right side of every pane", { skip }, async () => {
  const pane = async (selector: string): Promise<number> => {
    await page.waitForTimeout(600);
    const found = await brightest(page, await page.locator(selector).screenshot(), 235);
    assert.ok(found && found.count > 20, `${selector}: ${JSON.stringify(found)}`);
    return found.x;
  };
  const letters = (selector: string): Promise<string[]> => page.locator(`${selector} .overlay:not(.other) .edge`).allInnerTexts();
  // The mark alone is white.
  const id = await readyCase(server.address);
  const open = async (rest: string): Promise<void> => {
    await page.goto(`${origin}/?renderer=server#${id}&d=9&w=700,300&a=1&${rest}`);
    // The letters come with the picture.
    const view = /v=(\w+)/.exec(rest)?.[1] ?? "";
    await page.waitForFunction((name) => {
      const pane = document.querySelector<HTMLElement>("#surface");
      return pane?.dataset.depth === "9" && pane.querySelector(".pane-title")?.textContent?.toLowerCase().includes(name);
    }, view, { timeout: 20_000 });
  };
  for (const [view, right_at_left] of [["anterior", true], ["posterior", false], ["superior", false], ["inferior", true]] as const) {
    await open(`v=${view}`);
    const [left, right] = await letters("#surface");
    assert.deepEqual([left, right], right_at_left ? ["R", "L"] : ["L", "R"], view);
    const x = await pane("#surface .surface-host");
    assert.ok(right_at_left ? x < 0.45 : x > 0.55, `${view}: ${x}`);
  }
  await open("v=right&x=-38,0,0&l=slices");
  for (const plane of ["axial", "coronal"]) assert.ok((await pane(`.slice.${plane} .slice-image`)) < 0.45, plane);
  await open("v=right&x=-38,0,0&l=slices&c=n");
  for (const plane of ["axial", "coronal"]) assert.ok((await pane(`.slice.${plane} .slice-image`)) > 0.55, plane);
  await open("v=left&l=mirror");
  assert.ok((await pane("#surface .surface-host")) > 0.55, "the right hemisphere is in the right half");
});

test("a case that is being prepared shows how far it has come, live", { skip }, async () => {
  const head = headOfDemo();
  const id = head.ISOCORTEX_DEMO_VOLUME && head.ISOCORTEX_DEMO_MASK ? await uploadHead(head) : await upload(server.address, { volume: markedVolume(5), mask: brainMask() }, { name: "Second" });
  await page.goto(`${origin}/?renderer=server#${id}`);
  const said = new Set<string>();
  for (let time = 0; time < 400; time += 1) {
    const state = await page.locator(`#case-list [data-id="${id}"]`).getAttribute("data-state").catch(() => null);
    const note = await page.locator("#case-note").textContent();
    if (note) said.add(note);
    if (state === "ready") break;
    await page.waitForTimeout(25);
  }
  await shown(page);
  if (head.ISOCORTEX_DEMO_VOLUME) assert.ok([...said].filter((words) => words.includes("%")).length >= 2, [...said].join("; "));
});

async function uploadHead(head: Record<string, string>): Promise<string> {
  const { readFile } = await import("node:fs/promises");
  const form = new FormData();
  form.append("parameters", new Blob([JSON.stringify({ name: "Second" })], { type: "application/json" }));
  for (const [part, file] of [["volume", head.ISOCORTEX_DEMO_VOLUME], ["mask", head.ISOCORTEX_DEMO_MASK]] as const) {
    form.append(part, new Blob([new Uint8Array(await readFile(file ?? ""))]), `${part}.nii.gz`);
  }
  const response = await fetch(new URL("v1/cases", server.address), { method: "POST", body: form });
  return ((await response.json()) as { id: string }).id;
}

test("a search leaves the cases that match", { skip }, async () => {
  await page.locator("#case-search").fill("mark");
  assert.deepEqual(await page.locator("#case-list .title").allInnerTexts(), ["Marked"]);
  await page.locator("#case-search").fill("nobody");
  assert.match(await page.locator("#cases-note").innerText(), /No case matches/);
  await page.locator("#case-search").fill("");
  assert.equal(await page.locator("#case-list li").count(), 2);
  await keep(page, "cases");
});

test("over a slow line the first picture comes before the volume, whose bytes are counted", { skip, timeout: 90_000 }, async () => {
  const slow = await openPage(browser, { viewport: { width: 700, height: 600 } });
  const session = await slow.context.newCDPSession(slow.page);
  await session.send("Network.enable");
  // Fast 4G: 9 Mbit/s, 60 ms.
  await session.send("Network.emulateNetworkConditions", { offline: false, latency: 60, downloadThroughput: 9e6 / 8, uploadThroughput: 3e6 / 8 });
  const id = await readyCase(server.address);
  await slow.page.goto(`${origin}/?renderer=server#${id}`);
  await slow.page.waitForSelector("#surface[data-drawn=true]", { timeout: 30_000 });
  assert.equal(await slow.page.locator(".viewer[data-loaded=true]").count(), 0, "the volume is still on its way");
  await slow.page.waitForFunction(() => /\d MB/.test(document.querySelector(".notices")?.textContent ?? ""));
  await slow.page.locator(".cancel-load").click();
  await slow.page.waitForFunction(() => document.querySelector("#live")?.textContent === "Loading was cancelled.");
  await slow.context.close();
});

test("a server that dies is missed in words, and found again when it is back", { skip, timeout: 90_000 }, async () => {
  const port = Number(new URL(origin).port);
  await server.stop("SIGKILL");
  await page.locator("#depth").fill("6.5");
  await page.waitForSelector("#silence:not([hidden])", { timeout: 20_000 });
  assert.match(await page.locator("#silence").innerText(), /does not answer/);
  server = await startServer({ command: "serve", data: path.join(scratch.folder, "data"), port });
  await page.waitForSelector("#silence", { state: "hidden", timeout: 20_000 });
  await page.waitForSelector("#surface[data-depth='6.5']", { timeout: 20_000 });
});

test("a case is deleted only after a confirmation", { skip }, async () => {
  const item = page.locator("#case-list li", { hasText: "Marked" });
  const id = await item.getAttribute("data-id");
  await item.locator(".delete").click();
  await page.locator("dialog.confirm-delete button[value=keep]").click();
  assert.equal((await fetch(new URL(`v1/cases/${id}`, server.address))).status, 200);
  await item.locator(".delete").click();
  await page.keyboard.press("Escape");
  assert.equal((await fetch(new URL(`v1/cases/${id}`, server.address))).status, 200);
  await item.locator(".delete").click();
  await page.locator("dialog.confirm-delete button[value=delete]").click();
  await item.waitFor({ state: "detached" });
  assert.equal((await fetch(new URL(`v1/cases/${id}`, server.address))).status, 404);
});

test("nothing failed but what was made to, and nothing broke the content security policy", { skip }, () => {
  const expected = /422|400|ERR_CONNECTION_REFUSED|ERR_CONNECTION_RESET|ERR_EMPTY_RESPONSE|404|ERR_INCOMPLETE_CHUNKED/;
  assert.deepEqual(watched.troubles.filter((one) => !expected.test(one)), []);
});
