// Tests the widget of notebooks in a page that acts as the notebook. The page has a model with traits, and answers its messages
// as the Python package does. `python/tests/test_view.py` tests those answers.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";

import type { Page } from "playwright-core";

import { agreement } from "./pixels.ts";
import { ROOT, type Stage, keep, openPage, readyCase, skip, startStage } from "./support.ts";

let stage: Stage | undefined;
let id: string;

before(
  async () => {
    if (skip) return;
    stage = await startStage("demo");
    id = await readyCase(stage.server.address);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

/** What the page offers to the tests. */
interface Notebook {
  readonly traits: Record<string, unknown>;
  put(name: string, value: unknown): void;
  end(): void;
  readonly root: ShadowRoot;
}
type WithNotebook = typeof globalThis & { readonly notebook: Notebook };

/** A page with the widget in a cell; `direct` are the requests that did not go through the model. */
async function notebook(traits: Record<string, unknown> = {}) {
  assert.ok(stage);
  const { page, context, troubles } = await openPage(stage.browser, { viewport: { width: 700, height: 560 } });
  const address = new URL("/notebook", stage.server.address).href;
  const body = '<!doctype html><p class="bad" style="margin: 0; height: 20px">of the notebook</p><div id="cell"></div>';
  await context.route(address, (route) => route.fulfill({ contentType: "text/html", body }));
  await page.goto(address);
  const direct: string[] = [];
  page.on("request", (request) => {
    if (request.url().startsWith("http") && !request.headers()["x-kernel"]) direct.push(request.url());
  });
  const script = await readFile(path.join(ROOT, "python/isocortex/view.js"), "utf8");
  const first = { case_id: id, depth_mm: 8, view: "left", surface: "whole", overlay: null, height: 480, ...traits };
  await page.evaluate(standIn, { script, traits: first as Record<string, unknown> });
  return { page, close: () => context.close(), troubles, direct };
}

/** Runs in the page: a model as an anywidget has one, and the widget in the cell. */
async function standIn({ script, traits }: { script: string; traits: Record<string, unknown> }): Promise<void> {
  type Hear = (...of: unknown[]) => void;
  const hearers = new Map<string, Hear[]>();
  const hearing = (event: string): Hear[] => hearers.get(event) ?? [];
  const put = (name: string, value: unknown): void => {
    traits[name] = value;
    for (const hear of hearing(`change:${name}`)) hear();
  };
  const answer = async ({ ask, path, accept }: { ask: number; path: string; accept: string }): Promise<void> => {
    const response = await fetch(`/${path}`, { headers: { accept, "x-kernel": "1" } });
    const headers = Object.fromEntries([...response.headers].filter(([name]) => /^x-iso|^content-type/.test(name)));
    const body = new DataView(await response.arrayBuffer());
    const content = { answer: ask, status: response.status, headers };
    for (const hear of hearing("msg:custom")) hear(content, [body]);
  };
  const model = {
    get: (name: string) => traits[name],
    set: put,
    save_changes: () => {},
    on: (event: string, hear: Hear) => void hearers.set(event, [...hearing(event), hear]),
    off: (event: string, hear: Hear) =>
      void hearers.set(
        event,
        hearing(event).filter((one) => one !== hear),
      ),
    send: answer,
  };
  const address = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
  const { default: widget } = (await import(address)) as { default: { render(of: unknown): Promise<() => void> } };
  const el = document.getElementById("cell");
  const end = await widget.render({ model, el });
  Object.assign(window, { notebook: { traits, put, end, root: el?.shadowRoot } });
}

/** Waits until the picture is drawn in full, with a title, and with a map or without. */
const drawn = (page: Page, title: string, hasOverlay = false): Promise<unknown> =>
  page.waitForFunction(
    ([words, isOver]) => {
      const { root } = (window as unknown as WithNotebook).notebook;
      const canvas = root.querySelector<HTMLElement>("canvas.cortex");
      const isFull = canvas?.dataset.complete === "true" && canvas.dataset.quality === "full";
      const bar = root.querySelector<HTMLElement>(".map-bar");
      return isFull && root.querySelector(".pane-title")?.textContent === words && bar?.hidden === !isOver;
    },
    [title, hasOverlay] as const,
  );

const put = (page: Page, name: string, value: string | number | null): Promise<void> =>
  page.evaluate(([trait, its]) => (window as unknown as WithNotebook).notebook.put(trait, its), [name, value] as const);

const trait = (page: Page, name: string): Promise<unknown> =>
  page.evaluate((its) => (window as unknown as WithNotebook).notebook.traits[its], name);

/** The letters at the left, right, top and bottom of the picture. */
const letters = async (page: Page): Promise<string> => (await page.locator(".edge").allTextContents()).join("");

interface Facts {
  readonly intensity: { readonly window: { readonly center: number; readonly width: number } };
}

/** The share of what the server shows in a picture that the widget shows, too. */
async function agrees(page: Page, query: string): Promise<number> {
  const over = (visibility: string): Promise<void> =>
    page.evaluate((its) => {
      const { root } = (window as unknown as WithNotebook).notebook;
      const all = root.querySelectorAll<HTMLElement>(".pane > :not(.surface-host)");
      for (const element of all) element.style.visibility = its;
    }, visibility);
  await over("hidden");
  const canvas = page.locator("canvas.cortex");
  const [width, height] = await canvas.evaluate((one: HTMLCanvasElement) => [one.width, one.height]);
  const answer = await fetch(new URL(`v1/cases/${id}`, stage?.server.address));
  const { center, width: range } = ((await answer.json()) as Facts).intensity.window;
  const size = `width=${width}&height=${height}&window=${center},${range}`;
  const found = await agreement(page, `/v1/cases/${id}/render?${query}&renderer=trace&${size}`);
  await over("");
  return found.share_of_lit;
}

test("the widget draws what the server draws, by messages alone", { skip, timeout: 400_000 }, async () => {
  const { page, close, troubles, direct } = await notebook();
  await drawn(page, "8.0 mm  Left");
  // From the left, the face is on the left.
  assert.equal(await letters(page), "APSI");
  await keep(page, "widget");
  assert.deepEqual(direct, []);
  assert.ok((await agrees(page, "depth_mm=8&view=left")) > 0.97);
  assert.ok((await agrees(page, "depth_mm=8&view=right")) < 0.7);

  await put(page, "view", "superior");
  await put(page, "depth_mm", 15);
  await drawn(page, "15.0 mm  Superior");
  // Seen from above with the face at the top, the patient's left is on the left.
  assert.equal(await letters(page), "LRAP");
  assert.ok((await agrees(page, "depth_mm=15&view=superior")) > 0.97);

  await put(page, "overlay", "sharpness");
  await drawn(page, "15.0 mm  Superior", true);
  await keep(page, "widget-map");
  assert.ok((await agrees(page, "depth_mm=15&view=superior&overlay=sharpness")) > 0.97);
  assert.ok((await agrees(page, "depth_mm=15&view=superior")) < 0.7);
  await put(page, "overlay", null);
  await drawn(page, "15.0 mm  Superior");
  // Its style is its own, and the notebook's is not changed.
  assert.equal(
    await page
      .locator("p.bad")
      .first()
      .evaluate((one) => getComputedStyle(one).color),
    "rgb(0, 0, 0)",
  );
  assert.deepEqual(troubles, []);
  await close();
});

test("hands change the traits, and a half is drawn as itself", { skip, timeout: 400_000 }, async () => {
  const { page, close, troubles } = await notebook({ surface: "left", view: "right" });
  await drawn(page, "8.0 mm  Right  Left hemisphere");
  await keep(page, "widget-half");
  assert.equal(await letters(page), "PASI");

  await page.locator("input").fill("12.5");
  assert.equal(await trait(page, "depth_mm"), 12.5);
  await drawn(page, "12.5 mm  Right  Left hemisphere");
  const box = await page.locator(".pane").boundingBox();
  assert.ok(box);
  await page.mouse.move(box.x + 200, box.y + 200);
  await page.mouse.down();
  await page.mouse.move(box.x + 260, box.y + 220);
  await page.mouse.up();
  assert.equal(await trait(page, "view"), null);
  await drawn(page, "12.5 mm  Left hemisphere");
  await put(page, "view", "left");
  await drawn(page, "12.5 mm  Left  Left hemisphere");

  // What is not there is said, and the picture stays.
  await put(page, "overlay", "nothing");
  await page.locator("p[role=alert]", { hasText: "layer" }).waitFor();
  await page.evaluate(() => (window as unknown as WithNotebook).notebook.end());
  await put(page, "depth_mm", 3);
  assert.equal(await page.locator("canvas.cortex").count(), 0);
  assert.deepEqual(troubles, []);
  await close();
});
