// Title, letters, mark, depth and pixels of a pane belong to one state, or the pane is blank: over a slow connection, on a
// random walk through layouts, surfaces, views, depths and places. What a pane has said must look, whenever it says so, as it
// looks once all has come.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import {
  type Server,
  type Stage,
  keep,
  openPage,
  readyCase,
  rested,
  shown,
  skip,
  startStage,
  until,
} from "./support.ts";

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
  { timeout: 900_000 },
);

after(() => stage?.end());

/** 5 Mbit/s, 40 ms. */
async function slow(page: Page): Promise<void> {
  const session = await page.context().newCDPSession(page);
  await session.send("Network.enable");
  const throughput = { downloadThroughput: 5e6 / 8, uploadThroughput: 5e6 / 8 };
  await session.send("Network.emulateNetworkConditions", { offline: false, latency: 40, ...throughput });
}

/** What a pane says, and where its cross is. */
interface Said {
  readonly pane: string;
  /** Titles, letters and sides. */
  readonly title: string;
  readonly words: string;
  readonly box: { readonly x: number; readonly y: number; readonly width: number; readonly height: number };
}

/** What all panes in sight say; a blank one says nothing. */
const said = (page: Page): Promise<readonly Said[]> =>
  page.evaluate(() => {
    const panes = [...document.querySelectorAll<HTMLElement>(".panes .pane")];
    return panes
      .filter((pane) => pane.checkVisibility() && pane.clientWidth > 40 && !pane.classList.contains("blank"))
      .map((pane) => {
        const parts = pane.querySelectorAll<HTMLElement>(".edge, .pane-title, .badge, .map-lines text, .scale-text");
        const words = [...parts]
          .filter((part) => part.checkVisibility({ visibilityProperty: true }))
          .map((part) => part.textContent);
        const crosses = [...pane.querySelectorAll<SVGElement>(".cursor:not([hidden])")].map(
          ({ style }) => `${Math.round(parseFloat(style.left))} ${Math.round(parseFloat(style.top))}`,
        );
        const image = pane.querySelector(".surface-host, .slice-image, .map-image") ?? pane;
        const { x, y, width, height } = image.getBoundingClientRect();
        const size = `${Math.round(width)} ${Math.round(height)}`;
        const { layout } = pane.closest<HTMLElement>("[data-layout]")?.dataset ?? {};
        return {
          pane: pane.id || `${pane.dataset.pane} ${pane.className.replace(/ (large|troubled)/g, "")}`,
          title: words.join(),
          words: JSON.stringify([layout, size, ...words, ...crosses]),
          box: { x, y, width, height },
        };
      });
  });

/** The picture of all panes, in squares: the mean grey of each. */
async function squares(page: Page): Promise<readonly (readonly number[])[]> {
  const png = (await page.screenshot()).toString("base64");
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const [width, height] = [Math.round(image.width / 12), Math.round(image.height / 12)];
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d");
    if (!context) return [];
    context.imageSmoothingQuality = "high";
    context.drawImage(image, 0, 0, width, height);
    const { data } = context.getImageData(0, 0, width, height);
    return Array.from({ length: height }, (_, y) =>
      Array.from({ length: width }, (__, x) => data[4 * (y * width + x) + 1] ?? 0),
    );
  }, png);
}

interface Sample extends Said {
  readonly grey: readonly number[];
}

/** What all panes say and show in one moment; null: something has changed while it was looked at. */
async function sample(page: Page): Promise<readonly Sample[] | null> {
  const before = await said(page);
  const rows = await squares(page);
  if (JSON.stringify(await said(page)) !== JSON.stringify(before)) return null;
  return before.map((one) => {
    const { x, y, width, height } = one.box;
    const [left, right] = [Math.ceil(x / 12), Math.floor((x + width) / 12)];
    const inside = rows.slice(Math.ceil(y / 12), Math.floor((y + height) / 12));
    return { ...one, grey: inside.flatMap((row) => row.slice(left, right)) };
  });
}

/** How far two pictures differ, in grey levels on average. */
const differenceOf = (a: readonly number[], b: readonly number[]): number =>
  a.reduce((sum, value, at) => sum + Math.abs(value - (b[at] ?? 255)), 0) / Math.max(a.length, 1);

/** The same random numbers each time. */
function randomly(seed: number): (count: number) => number {
  let state = seed;
  return (count) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * count);
  };
}

const LAYOUTS = ["single", "slices", "mirror", "both", "closer", "map"] as const;
const SURFACES = ["whole", "left", "right", "cerebrum"] as const;
const VIEWS = ["left", "right", "anterior", "superior", "mesial-left", "mesial-right"] as const;
/** Places on both sides, outside and at the midsagittal plane, in LPS mm. */
const PLACES = ["45,-20,20", "-45,-20,20", "5,-30,30", "-5,-30,30", "30,40,25", "-30,40,25"] as const;
const DEPTHS = [4, 9, 14] as const;
/** A coarse picture of the same state differs by less on average, another one by more. */
const MOST_DIFFERENT = 9;

for (const renderer of ["", "?renderer=server"]) {
  test(
    `on a random walk over a slow connection, each pane is of one state or blank${renderer && " (the server draws)"}`,
    { skip, timeout: 900_000 },
    async () => {
      const { page, context, troubles } = await openPage(browser, { viewport: { width: 1440, height: 900 } });
      const origin = new URL(`/${renderer}`, server.address).href;
      await page.goto(`${origin}#${id}&r=${renderer ? "server" : "mesh"}`);
      await shown(page);
      await slow(page);
      const pick = randomly(20261128);
      const any = <Word>(words: readonly Word[]): Word => words[pick(words.length)] as Word;
      const samples: (Sample & { readonly step: number })[] = [];
      const truth = new Map<string, Sample>();
      const learn = async (): Promise<void> => {
        await rested(page);
        for (const one of (await sample(page)) ?? []) truth.set(`${one.pane} ${one.words}`, one);
      };
      await learn();
      for (let step = 0; step < 14; step += 1) {
        const inner = any(["", "i=1"]);
        const parts = [
          `f=${any(SURFACES)}`,
          `l=${any(LAYOUTS)}`,
          `d=${any(DEPTHS)}`,
          `v=${any(VIEWS)}`,
          `x=${any(PLACES)}`,
          inner,
          any(["", "n=axial", "n=sagittal"]),
          // A slice and the surface with a series of their own.
          any(["", "B=1&Bb=junction"]),
          any(["", "S=1&Sb=junction"]),
        ];
        const rest = [`r=${renderer ? "server" : "mesh"}`, ...parts.filter(Boolean)].join("&");
        await page.evaluate((hash) => (location.hash = hash), `${id}&${rest}`);
        // As it changes, and until nothing does.
        let last = "";
        await until(
          async () => {
            const now = await sample(page);
            for (const pane of now ?? []) samples.push({ ...pane, step });
            const [before, words] = [last, JSON.stringify(now)];
            last = words;
            const isWaiting = await page.evaluate(() =>
              [...document.querySelectorAll(".pane.blank, .awaited:not([hidden])")].some((one) =>
                one.checkVisibility(),
              ),
            );
            return now !== null && words === before && !isWaiting;
          },
          Boolean,
          60,
        );
        await page.waitForLoadState("networkidle");
        await learn();
      }
      const compared = samples.flatMap((found) => {
        const grey = truth.get(`${found.pane} ${found.words}`)?.grey;
        return grey ? [{ ...found, difference: differenceOf(found.grey, grey) }] : [];
      });
      const wrong = compared.filter(({ difference }) => difference > MOST_DIFFERENT);
      console.log(
        `${samples.length} looked at, ${compared.length} compared, ${Math.max(...compared.map(({ difference }) => difference)).toFixed(1)} at most`,
      );
      // No other state than one that was asked for is shown on the way.
      const titles = new Set([...truth.values()].map(({ pane, title }) => `${pane} ${title}`));
      const strange = samples.filter(({ pane, title }) => pane === "surface" && !titles.has(`${pane} ${title}`));
      if (wrong.length > 0) await keep(page, "one-state-wrong");
      assert.deepEqual(
        wrong.map(({ pane, words, step, difference }) => [step, pane, words, difference]),
        [],
      );
      assert.deepEqual(
        strange.map(({ title, step }) => [step, title]),
        [],
      );
      assert.ok(compared.length > 60, `${compared.length} samples`);
      assert.deepEqual(troubles, []);
      await context.close();
    },
  );
}
