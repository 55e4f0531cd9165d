// What a pane shows, pixel by pixel, against the server's pictures.

import type { Page } from "playwright-core";

/** How two pictures of one size agree. */
export interface Agreement {
  /** The share of pixels whose red, green and blue are within 4 of 255. */
  readonly share: number;
  /** The same of the pixels that are not background in the second. */
  readonly share_of_lit: number;
  readonly size: readonly [number, number];
}

/** Hides what stands on the picture, so that the picture alone is seen; or shows it again. */
export async function bare(page: Page, is_bare = true): Promise<void> {
  await page.evaluate((hidden) => {
    const over = "#surface > :not(.surface-host), .loading-line, .slice .pane-head";
    for (const element of document.querySelectorAll<HTMLElement>(over))
      element.style.visibility = hidden ? "hidden" : "";
  }, is_bare);
}

/** The size of the surface's canvas in pixels. */
export const canvasSize = (page: Page): Promise<readonly [number, number]> =>
  page.evaluate(() => {
    const canvas = document.querySelector<HTMLCanvasElement>("canvas.cortex");
    return [canvas?.width ?? 0, canvas?.height ?? 0] as const;
  });

/** Shows what an address says, and waits until it is drawn in full. */
export async function show(page: Page, fragment: string, way: string): Promise<void> {
  const before = await page.evaluate(() =>
    Number(document.querySelector<HTMLElement>("canvas.cortex")?.dataset.frames ?? 0),
  );
  await page.evaluate((hash) => {
    location.hash = hash;
  }, fragment);
  await page.waitForFunction(
    ([frames, wanted]) => {
      const canvas = document.querySelector<HTMLElement>("canvas.cortex");
      const viewer = document.querySelector<HTMLElement>(".viewer");
      return (
        Number(canvas?.dataset.frames) > frames && canvas?.dataset.quality === "full" && viewer?.dataset.way === wanted
      );
    },
    [before, way] as const,
  );
  // The frame is on the screen with the next one but one.
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
}

/** What part of the canvas is compared, and how it is turned before. */
export interface Part {
  readonly left: number;
  readonly width: number;
  readonly is_flipped: boolean;
}

/**
 * Compares the canvas, or a part of it, with the server's picture at `address`: pixels within `tolerance` of 255 are
 * alike.
 */
export async function agreement(page: Page, address: string, part?: Part, tolerance = 4): Promise<Agreement> {
  // The screen's pixels that the canvas is painted on: its edges may lie between them.
  const clip = await page.locator("canvas.cortex").evaluate((canvas: HTMLCanvasElement) => {
    const { left, top } = canvas.getBoundingClientRect();
    return { x: Math.round(left), y: Math.round(top), width: canvas.width, height: canvas.height };
  });
  const shot = await page.screenshot({ clip });
  return page.evaluate(
    async ({ base64, address, part, tolerance }) => {
      const own = await createImageBitmap(new Blob([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))]));
      const answer = await fetch(address);
      if (!answer.ok) throw new Error(`${address}: ${await answer.text()}`);
      const other = await createImageBitmap(await answer.blob());
      const pixels = (image: ImageBitmap, from: { left: number; is_flipped: boolean }): Uint8ClampedArray => {
        const canvas = new OffscreenCanvas(other.width, other.height);
        const context = canvas.getContext("2d", { willReadFrequently: true });
        if (!context) throw new Error("no canvas");
        if (from.is_flipped) context.setTransform(-1, 0, 0, 1, other.width, 0);
        context.drawImage(image, -from.left, 0);
        return context.getImageData(0, 0, other.width, other.height).data;
      };
      const [a, b] = [
        pixels(own, part ?? { left: 0, is_flipped: false }),
        pixels(other, { left: 0, is_flipped: false }),
      ];
      let [near, lit, near_lit] = [0, 0, 0];
      for (let at = 0; at < b.length; at += 4) {
        const off = Math.max(...[0, 1, 2].map((channel) => Math.abs((a[at + channel] ?? 0) - (b[at + channel] ?? 0))));
        const is_lit = (b[at] ?? 0) > 0;
        near += off <= tolerance ? 1 : 0;
        lit += is_lit ? 1 : 0;
        near_lit += is_lit && off <= tolerance ? 1 : 0;
      }
      return {
        share: (4 * near) / b.length,
        share_of_lit: near_lit / Math.max(lit, 1),
        size: [other.width, other.height] as const,
      };
    },
    { base64: shot.toString("base64"), address, part, tolerance },
  );
}

/** The share of pixels of the flat map, as the page has drawn it, that are within 4 of 255 of the server's picture of as many pixels. */
export async function mapAgrees(page: Page, server: string, id: string): Promise<number> {
  const [own, { width, height }] = await page
    .locator(".map-image canvas")
    .evaluate((canvas: HTMLCanvasElement) => [canvas.toDataURL(), { width: canvas.width, height: canvas.height }]);
  const known = new URLSearchParams((await page.locator(".flat-map").getAttribute("data-known")) ?? "");
  known.set("width", String(width));
  known.set("height", String(height));
  const { intensity } = (await (await fetch(new URL(`v1/cases/${id}`, server))).json()) as {
    readonly intensity: { readonly window: { readonly center: number; readonly width: number } };
  };
  known.set("window", `${intensity.window.center},${intensity.window.width}`);
  return picturesAgree(page, own, `v1/cases/${id}/render?${known}`);
}

/** The share of pixels of a picture, as a data URL, that are within 4 of 255 of the server's at an address. */
export const picturesAgree = (page: Page, own: string, address: string): Promise<number> =>
  page.evaluate(
    async ([own, address]) => {
      const pixels = async (from: string): Promise<Uint8ClampedArray> => {
        const image = new Image();
        image.src = from;
        await image.decode();
        const canvas = document.createElement("canvas");
        Object.assign(canvas, { width: image.naturalWidth, height: image.naturalHeight });
        const context = canvas.getContext("2d", { willReadFrequently: true });
        context?.drawImage(image, 0, 0);
        return context?.getImageData(0, 0, canvas.width, canvas.height).data ?? new Uint8ClampedArray();
      };
      const [a, b] = await Promise.all([pixels(own), pixels(address)]);
      if (a.length !== b.length) throw new Error(`${a.length / 4} and ${b.length / 4} pixels`);
      let far = 0;
      for (let at = 0; at < a.length; at += 4) {
        const off = [0, 1, 2].map((channel) => Math.abs((a[at + channel] ?? 0) - (b[at + channel] ?? 0)));
        if (Math.max(...off) > 4) far += 1;
      }
      return 1 - (4 * far) / a.length;
    },
    [own, address] as const,
  );
