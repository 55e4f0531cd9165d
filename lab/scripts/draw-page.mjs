// Draws the page of the README: docs/page.jpg.
//
//     node lab/scripts/draw-page.mjs VOLUME MASK [PROGRAM]
//
// VOLUME and MASK are Colin27 (scripts/head.sh finds or fetches ch2.nii.gz) and a mask of its brain. Needs Chromium.
import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, openAsBlob, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import path from "node:path";
import { createInterface } from "node:readline";

const root = path.join(import.meta.dirname, "../..");
const { chromium } = createRequire(path.join(root, "web/package.json"))("playwright-core");
const [volume, mask, program = path.join(root, "target/debug/isocortex")] = process.argv.slice(2);
if (!mask) throw new Error("usage: draw-page.mjs VOLUME MASK [PROGRAM]");
const VIEW = "d=8&l=slices";

const folder = mkdtempSync(path.join(tmpdir(), "page-"));
const server = spawn(program, ["serve", "--create", "--data", folder, "--listen", "127.0.0.1:0"], { stdio: ["ignore", "pipe", "inherit"] });
try {
  let address;
  for await (const line of createInterface(server.stdout)) {
    address = line.match(/http:\/\/127[^ ]*/)?.[0];
    if (address) break;
  }
  const form = new FormData();
  form.set("volume", await openAsBlob(volume), "volume.nii.gz");
  form.set("mask", await openAsBlob(mask), "mask.nii.gz");
  form.set("parameters", JSON.stringify({ name: "Colin27" }));
  const { id } = await (await fetch(`${address}/v1/cases`, { method: "POST", body: form })).json();
  const isDone = async () => (await (await fetch(`${address}/v1/cases/${id}`)).json()).maps?.state === "ready";
  while (!(await isDone())) await new Promise((resolve) => setTimeout(resolve, 500));

  const executablePath = execFileSync(path.join(root, "scripts/chromium.sh"), { encoding: "utf8" }).trim();
  const args = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox", "--force-color-profile=srgb"];
  const browser = await chromium.launch({ executablePath, args });
  const page = await browser.newPage({ viewport: { width: 1440, height: 900 }, colorScheme: "dark" });
  await page.goto(`${address}/#${id}&${VIEW}`);
  await page.click(".first-time button");
  await page.waitForSelector('[data-loaded="true"][data-rested="true"]', { timeout: 120_000 });
  await page.mouse.dblclick(330, 225);
  await page.mouse.move(1000, 20);
  // The slices and the profile of the point follow.
  await page.waitForTimeout(3_000);
  await page.screenshot({ path: path.join(root, "docs/page.jpg"), type: "jpeg", quality: 85 });
  await browser.close();
} finally {
  server.kill();
  rmSync(folder, { recursive: true, force: true });
}
