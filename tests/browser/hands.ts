// What the tests of the viewer do with its page.

import assert from "node:assert/strict";

import type { Browser, Page } from "playwright-core";

import { type Server, type Watched, fragment, openPage, readyCase, shown, startStage } from "./support.ts";

export interface Hands {
  text(selector: string): Promise<string>;
  /** The case as it is first shown. */
  reset(): Promise<void>;
  /** Where the surface is. */
  surface(): Promise<{ readonly x: number; readonly y: number; readonly width: number; readonly height: number }>;
  /** The directions at the edges of a pane: left, right, top, bottom. */
  letters(pane: string): Promise<string>;
}

/** Hands on a page that shows the case at an address. */
export const handsOn = (page: Page, address: string): Hands => ({
  text: (selector) => page.locator(selector).innerText(),
  async reset() {
    await page.goto(address);
    await page.locator(".layouts button[value=single]").click();
    await page.getByRole("button", { name: "Reset everything" }).click();
    // Hands are on the picture that is up: the one of the test before may stand a while.
    await page.waitForFunction(
      () => document.querySelector("#surface:not(.halved) .pane-title")?.textContent === "10.0 mm  Left",
    );
    // What the test before has shown may still be there.
    const { x, d } = await fragment(page);
    assert.deepEqual([x, d], [undefined, undefined]);
  },
  async surface() {
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    return box;
  },
  letters: async (pane) => (await page.locator(`${pane} .overlay:not(.other) .edge`).allInnerTexts()).join(" "),
});

/** The demo with its case on a page. The server draws, for WebGL2 in software is slow. */
export interface Demo {
  readonly server: Server;
  readonly browser: Browser;
  readonly watched: Watched;
  readonly page: Page;
  readonly id: string;
  /** The address of the page, without its case. */
  readonly origin: string;
  readonly hands: Hands;
  end(): Promise<void>;
}

export async function startDemo(): Promise<Demo> {
  const stage = await startStage("demo");
  try {
    const { server, browser } = stage;
    const id = await readyCase(server.address);
    const watched = await openPage(browser);
    const { page } = watched;
    const origin = `${new URL(server.address).origin}/?renderer=server`;
    await page.goto(origin);
    await shown(page);
    return {
      server,
      browser,
      watched,
      page,
      id,
      origin,
      hands: handsOn(page, `${origin}#${id}`),
      end: () => stage.end(),
    };
  } catch (error) {
    await stage.end();
    throw error;
  }
}
