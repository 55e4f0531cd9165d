// The page in windows of five sizes, in both languages and themes: nothing is cut off, and no control covers another.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { brainMask, markedVolume } from "./phantom.ts";
import { type Server, type Stage, keep, openPage, shown, skip, speak, startStage } from "./support.ts";
import { sendCase } from "./uploads.ts";

const SIZES = [
  [390, 844],
  [820, 1180],
  [1024, 768],
  [1440, 900],
  [1920, 1200],
] as const;

let stage: Stage | undefined;
let server: Server;
let browser: Browser;

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    const parameters = '{"name":"A label of some length, as people give them"}';
    await sendCase(server, { volume: markedVolume(), mask: brainMask(), parameters });
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

/** What is wrong with the page as it is laid out, in words. */
const faults = (page: Page): Promise<string[]> =>
  page.evaluate(() => {
    const found: string[] = [];
    const root = document.documentElement;
    if (root.scrollWidth > root.clientWidth) found.push(`the page is ${root.scrollWidth} wide`);
    const nameOf = (one: Element): string =>
      `${one.id || one.getAttribute("aria-label") || one.textContent?.trim().slice(0, 30) || one.tagName}`;
    const controls = [...document.querySelectorAll<HTMLElement>("button, select, input, summary")].filter(
      (one) => one.checkVisibility() && one.getBoundingClientRect().width > 2,
    );
    for (const one of controls) {
      const box = one.getBoundingClientRect();
      if (box.left < -1 || box.right > root.clientWidth + 1) found.push(`${nameOf(one)} is beside the window`);
      if (one.matches("button, summary") && one.scrollWidth > one.clientWidth + 1)
        found.push(`the words of ${nameOf(one)} are cut off`);
    }
    // All of the bar is in its first lines: the list would cover what is wrapped below it.
    const [bar, list] = [".bar", ".sidebar"].map((one) => document.querySelector(one)?.getBoundingClientRect());
    const inBar = controls.filter((one) => one.closest(".bar"));
    for (const one of inBar) {
      const box = one.getBoundingClientRect();
      const isUnder =
        list && list.width > 0 && box.left < list.right && box.bottom > list.top + 1 && box.top < list.bottom;
      if (bar && isUnder) found.push(`the list covers ${nameOf(one)}`);
    }
    for (const group of [".bar", ".depth-bar", ".panel", ".sidebar"]) {
      const own = controls.filter((one) => one.closest(group));
      for (const [at, one] of own.entries()) {
        for (const other of own.slice(at + 1)) {
          if (one.contains(other) || other.contains(one)) continue;
          const [a, b] = [one.getBoundingClientRect(), other.getBoundingClientRect()];
          const [across, down] = [
            Math.min(a.right, b.right) - Math.max(a.left, b.left),
            Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top),
          ];
          if (across > 1 && down > 1) found.push(`${nameOf(one)} covers ${nameOf(other)}`);
        }
      }
    }
    const boxesOf = (pane: Element, names: string): readonly DOMRect[] =>
      [...pane.querySelectorAll(names)]
        .filter((one) => one.checkVisibility() && one.textContent !== "")
        .map((one) => one.getBoundingClientRect());
    for (const pane of document.querySelectorAll(".pane")) {
      const covers = (a: DOMRect, b: DOMRect): boolean =>
        Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
        Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
      const names = [".pane-notice", ".scale-text", ".colour-bar", ".pane-title", ".pane-case", ".badge", ".edge"];
      for (const [at, name] of names.entries())
        for (const other of names.slice(at + 1))
          if (boxesOf(pane, name).some((one) => boxesOf(pane, other).some((two) => covers(one, two))))
            found.push(`${name} covers ${other} of ${pane.className}`);
      for (const title of pane.querySelectorAll(".slice-bar .pane-title"))
        if (title.checkVisibility() && title.scrollWidth > title.clientWidth + 1)
          found.push(`the name of ${pane.className} is cut off`);
    }
    return found;
  });

test("nothing is cut off or covered in any size, language and theme", { skip, timeout: 900_000 }, async () => {
  const { page, troubles, context } = await openPage(browser);
  await page.goto(`${new URL("/", server.address).origin}/?renderer=server`);
  await shown(page);
  const wrong: string[] = [];
  for (const [language, layout] of [
    ["en", "slices"],
    ["pt-BR", "both"],
  ] as const) {
    await speak(page, language);
    await shown(page);
    await page.locator(`.layouts button[value=${layout}]`).click();
    await page.waitForSelector(".slice[data-way]");
    for (const theme of ["dark", "light"]) {
      await page.evaluate((wanted) => {
        document.documentElement.dataset.theme = wanted;
      }, theme);
      for (const [width, height] of SIZES) {
        await page.setViewportSize({ width, height });
        const name = `size-${width}x${height}-${language}-${theme}`;
        // The words stand as the picture does, which the server draws anew.
        await page.waitForFunction((isHalved) => {
          const { clientWidth, clientHeight, classList } = document.querySelector("#surface") as HTMLElement;
          const isStacked = isHalved && clientWidth < clientHeight;
          return classList.contains("halved") === isHalved && classList.contains("stacked") === isStacked;
        }, layout === "both");
        await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
        wrong.push(...(await faults(page)).map((fault) => `${name}: ${fault}`));
        await keep(page, name);
      }
    }
  }
  assert.deepEqual(wrong, []);
  assert.deepEqual(troubles, []);
  await context.close();
});
