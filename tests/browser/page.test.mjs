// The page against the program itself: `isocortex demo` on a free port, its data in a temporary folder, and Chromium.
//
// Needs the built program (ISOCORTEX_BINARY, else target/debug/isocortex) and Chromium; without the latter the tests
// are skipped, but on CI (CI=true) they fail. Screenshots are left in target/browser/.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdir, mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";

import { findChromium, launch } from "./chromium.mjs";

const root = path.join(import.meta.dirname, "../..");
const program = path.resolve(root, process.env.ISOCORTEX_BINARY || "target/debug/isocortex");
const pictures = path.join(root, "target/browser");
const chromium = findChromium();
const skip = !chromium && process.env.CI !== "true" ? "no Chromium is installed" : false;
if (skip) console.error(`SKIPPED: ${skip}; install the package chromium or set CHROMIUM`);

let scratch;
let server;
let browser;
let page;
let address;

before(async () => {
  if (skip) return;
  assert.ok(chromium, "no Chromium is installed, which CI needs");
  scratch = await mkdtemp(path.join(tmpdir(), "isocortex-page-"));
  ({ server, address } = await startDemo(path.join(scratch, "data")));
  browser = await launch(chromium);
  page = browser.page;
  await page.resize(1440, 900);
  await page.open(address);
}, { timeout: 300_000 });

after(async () => {
  await browser?.close();
  if (server?.exitCode === null) {
    server.kill("SIGTERM");
    await once(server, "exit");
  }
  if (scratch) await rm(scratch, { recursive: true, force: true });
});

/** Starts the demo and waits until it prints the address to open. */
async function startDemo(data) {
  // Nothing of the machine's own configuration: the demo as a newcomer sees it.
  const env = Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith("ISOCORTEX_")));
  const child = spawn(program, ["demo"], {
    stdio: ["ignore", "pipe", "pipe"],
    env: { ...env, ISOCORTEX_DATA: data, ISOCORTEX_LISTEN: "127.0.0.1:0" },
  });
  const said = [];
  const started = new Promise((resolve, reject) => {
    child.on("error", reject);
    child.on("exit", (code) => reject(new Error(`the demo ended with ${code}:\n${said.join("\n")}`)));
    for (const stream of [child.stdout, child.stderr]) {
      createInterface({ input: stream }).on("line", (line) => {
        said.push(line);
        const found = line.match(/http:\/\/[^\s"]+/);
        if (stream === child.stdout && found) resolve(found[0]);
      });
    }
  });
  return { server: child, address: await started };
}

/** Keeps what the page looks like, for people to look at. */
async function keep(name) {
  await mkdir(pictures, { recursive: true });
  await writeFile(path.join(pictures, `${name}.png`), await page.screenshot());
}

const loaded = (selector) => `Number(document.querySelector(${JSON.stringify(selector)}).dataset.naturalWidth) > 0`;

/** The share of a picture's pixels that are not black. */
const litShare = (selector) => page.evaluate(`(() => {
  const image = document.querySelector(${JSON.stringify(selector)});
  const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let lit = 0;
  for (let at = 0; at < data.length; at += 4) if (data[at] + data[at + 1] + data[at + 2] > 30) lit += 1;
  return lit / (canvas.width * canvas.height);
})()`);

const text = (selector) => page.evaluate(`document.querySelector(${JSON.stringify(selector)}).textContent.trim()`);

test("the page lists the demo's case and shows it", { skip }, async () => {
  await page.until("document.querySelector('#case-list [data-state=ready]') !== null", "a ready case in the list", 240);
  for (const frame of ["#viewport", "#slice-frame"]) await page.until(loaded(frame), `a picture in ${frame}`);
  await page.until("[...document.querySelectorAll('#strip button')].every((b) => Number(b.dataset.naturalWidth) > 0)", "six views");
  await keep("desktop");
  for (const picture of ["#render", "#slice"]) {
    const share = await litShare(picture);
    assert.ok(share > 0.1 && share < 0.95, `${picture}: ${share} of the pixels are lit`);
  }
});

test("the page says what the pictures are not for", { skip }, async () => {
  assert.equal(await text(".notice"), "For research use only. Not for diagnosis.");
  await page.evaluate("window.scrollTo(0, document.body.scrollHeight)");
  const top = await page.evaluate("document.querySelector('.notice').getBoundingClientRect().top");
  assert.ok(top >= 0, "the notice stays in sight when the page is scrolled");
  await page.evaluate("window.scrollTo(0, 0)");
});

test("the wheel peels, and the picture follows", { skip }, async () => {
  const before = parseFloat(await text("#depth-shown"));
  const seen = await page.evaluate("document.querySelector('#render').src");
  await page.wheel("#viewport", 240);
  await page.until(`document.querySelector('#render').src !== ${JSON.stringify(seen)}`, "another picture");
  await page.until(`parseFloat(document.querySelector('#depth-shown').textContent) > ${before}`, "a deeper cut");
});

test("the letters at the edges belong to the view that is shown", { skip }, async () => {
  const letters = async () => Promise.all(["left", "right", "top", "bottom"].map((side) => text(`#viewport .edge.${side}`)));
  assert.deepEqual(await letters(), ["A", "P", "S", "I"]);
  await page.evaluate("document.querySelector('#viewport').focus()");
  await page.press("a", "a");
  await page.until("document.querySelector('#render').alt.endsWith('anterior view')", "the anterior view");
  assert.deepEqual(await letters(), ["R", "L", "S", "I"]);
});

test("a tablet shows the page without scrolling sideways", { skip }, async () => {
  await page.resize(820, 1180);
  await page.until("document.documentElement.scrollWidth <= 820", "a page no wider than the screen");
  await page.until("document.querySelector('#viewport').clientWidth > 400", "a picture of good size");
  await keep("tablet");
  await page.resize(1440, 900);
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(page.troubles, []);
});

test("a file that is no volume is refused in words", { skip }, async () => {
  const file = path.join(scratch, "not-a-volume.nii");
  await writeFile(file, "this is no NIfTI file");
  await page.evaluate("document.querySelector('#add').open = true");
  await page.choose("#upload input[name=volume]", [file]);
  await page.evaluate("document.querySelector('#upload').requestSubmit()");
  const refused = `document.querySelector('#upload-note').classList.contains('error')
    || document.querySelector('#case-list [data-state=failed]') !== null`;
  await page.until(refused, "an error");
  const words = await page.evaluate(`document.querySelector('#case-list [data-state=failed] .status')?.textContent
    || document.querySelector('#upload-note').textContent`);
  assert.match(words, /nifti/i);
  assert.doesNotMatch(words, /not-a-volume|status \d/, "neither the file's name nor a bare status");
});

test("a case is deleted only after a confirmation", { skip }, async () => {
  await page.evaluate("location.hash = document.querySelector('#case-list [data-state=ready] a').hash");
  await page.until("!document.querySelector('#viewer').hidden", "the ready case");
  const id = await page.evaluate("location.hash.slice(1)");
  await page.click("#delete");
  await page.click("#confirm-delete button[value=keep]");
  assert.equal((await fetch(new URL(`v1/cases/${id}`, address))).status, 200);
  await page.click("#delete");
  await page.click("#confirm-delete button[value=delete]");
  await page.until(`document.querySelector('#case-list [data-id="${id}"]') === null`, "the case to leave the list");
  assert.equal((await fetch(new URL(`v1/cases/${id}`, address))).status, 404);
});
