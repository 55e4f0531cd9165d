// The surface that the page draws, against the pictures that the server draws, and what becomes of it when things go
// wrong.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, CDPSession, Page } from "playwright-core";

import { NAMED_VIEWS, mirrored } from "../../web/src/model/camera.ts";
import type { ReadyCase } from "../../web/src/model/case.ts";
import { fitted } from "../../web/src/model/surfaces.ts";
import { agreement, bare, canvasSize, mapAgrees, show } from "./pixels.ts";
import { type Server, type Stage, fragment, keep, openPage, readyCase, skip, startStage } from "./support.ts";

const VIEWS = ["left", "right", "anterior", "posterior", "superior", "inferior"] as const;
const DEPTHS_MM = [0, 2, 8, 15, 30] as const;
/** The page's mesh. */
const MESH = "contours=80&points=50";
/** So that the surface's pane is 600 by 496 pixels. */
const VIEWPORT = { width: 600, height: 800 };

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

interface Facts {
  readonly window: { readonly center: number; readonly width: number };
  readonly envelope_sphere: {
    readonly center_in_patient: readonly [number, number, number];
    readonly radius_mm: number;
  };
}

async function facts(surface = "whole"): Promise<Facts> {
  const answer = await fetch(new URL(`v1/cases/${id}?surface=${surface}`, server.address));
  const found = (await answer.json()) as Facts & { intensity: Facts };
  return { window: found.intensity.window, envelope_sphere: found.envelope_sphere };
}

/** A page that shows the case and has fetched all that it draws with. */
async function loadedPage(
  fragment = "",
  query = "",
): Promise<{ readonly page: Page; readonly troubles: string[]; close(): Promise<void> }> {
  const { page, troubles, context } = await openPage(browser, { viewport: VIEWPORT });
  await page.goto(`${new URL(`/${query}`, server.address)}#${id}&r=exact${fragment}`);
  await page.waitForFunction(() => document.querySelector<HTMLElement>(".viewer")?.dataset.way === "exact", null, {});
  await page.waitForFunction(
    () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.complete === "true",
    null,
  );
  return { page, troubles, close: () => context.close() };
}

/** Where the server draws the same picture. */
async function rendered(
  view: string,
  depth_mm: number,
  renderer: string,
  size: readonly [number, number],
): Promise<string> {
  const { center, width } = (await facts()).window;
  const mesh = renderer === "mesh" ? `&${MESH}` : "";
  const picture = `window=${center},${width}&width=${size[0]}&height=${size[1]}`;
  return `/v1/cases/${id}/render?depth_mm=${depth_mm}&view=${view}&renderer=${renderer}${mesh}&${picture}`;
}

test(
  "the page's pictures are the server's: 99 % of the pixels within 4/255 in both ways, five depths and six views",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, close } = await loadedPage();
    await bare(page);
    const size = await canvasSize(page);
    const poor: string[] = [];
    const table = [
      `pixels within 4/255 of the server's, % (of ${size.join(" × ")}; in brackets of those that are not background)`,
      `way   depth  ${VIEWS.join("  ")}`,
    ];
    for (const [way, renderer] of [
      ["mesh", "mesh"],
      ["exact", "trace"],
    ] as const) {
      for (const depth_mm of DEPTHS_MM) {
        const row: string[] = [];
        for (const view of VIEWS) {
          await show(page, `#${id}&r=${way}&d=${depth_mm}&v=${view}&g=0`, way);
          const { share, share_of_lit } = await agreement(page, await rendered(view, depth_mm, renderer, size));
          row.push(`${(100 * share).toFixed(2)} (${(100 * share_of_lit).toFixed(2)})`);
          if (share < 0.99) poor.push(`${way}, ${depth_mm} mm, ${view}: ${share}`);
        }
        table.push(`${way.padEnd(5)} ${String(depth_mm).padStart(5)}  ${row.join("  ")}`);
      }
    }
    console.log(table.join("\n"));
    assert.deepEqual(poor, []);
    // Near the envelope the page averages, and says so; the server does as much when it is asked to.
    await show(page, `#${id}&r=exact&d=0.5&v=left`, "exact");
    const address = `${await rendered("left", 0.5, "trace", size)}&slab_mm=0.5`;
    const averaged = await agreement(page, address);
    const sharp = await agreement(page, address.replace("&slab_mm=0.5", ""));
    console.log(`averaged over 1 mm at 0.5 mm: ${averaged.share}; not averaged: ${sharp.share}`);
    assert.ok(averaged.share >= 0.99 && sharp.share < averaged.share, `${averaged.share}, ${sharp.share}`);
    assert.equal(await page.locator("#surface .pane-title").first().textContent(), "0.5 mm, mean of 1.0 mm  Left");
    assert.deepEqual(troubles, []);
    await close();
  },
);

test(
  "the halves and the cerebrum are the server's pictures, at the place of the whole brain, and points are found on them",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, close } = await loadedPage("&d=8&v=right");
    await page.locator("#surface").focus();
    await page.keyboard.press("q");
    await page.waitForSelector('#surface[data-surface="left"]');
    assert.equal((await fragment(page)).f, "left");
    const title = await page.locator("#surface .pane-title").first().textContent();
    assert.equal(title, "8.0 mm  Left hemisphere, inner side");
    await keep(page, "surface-left-inner");
    const size = await canvasSize(page);
    const whole = (await facts()).envelope_sphere;
    await bare(page);
    for (const [surface, view, way] of [
      ["left", "right", "exact"],
      ["right", "left", "exact"],
      ["right", "right", "mesh"],
      ["cerebrum", "inferior", "exact"],
    ] as const) {
      await show(page, `#${id}&f=${surface}&r=${way}&d=8&v=${view}&g=0&z=1.2&p=5,-3`, way);
      assert.equal(await page.locator("#surface").getAttribute("data-surface"), surface);
      const camera = { orientation: NAMED_VIEWS[view], zoom: 1.2, pan_mm: [5, -3] as const };
      const { zoom, pan_mm } = fitted(camera, whole, (await facts(surface)).envelope_sphere);
      const renderer = way === "mesh" ? "mesh" : "trace";
      const address = await rendered(view, 8, renderer, size);
      const own = `${address}&surface=${surface}&zoom=${zoom}&pan=${pan_mm.join(",")}`;
      const { share, share_of_lit } = await agreement(page, own);
      console.log(`${surface} ${view} ${way}: ${share} (${share_of_lit})`);
      assert.ok(share >= 0.99 && share_of_lit >= 0.97, `${surface}, ${view}, ${way}: ${share}, ${share_of_lit}`);
      const other = await agreement(page, `${address}&zoom=1.2&pan=5,-3`);
      assert.ok(other.share < 0.9, `the whole brain would do as well: ${other.share}`);
    }
    await bare(page, false);
    // Marked on the inner side, a point lies on that half.
    await show(page, `#${id}&f=left&r=exact&d=8&v=right&g=0&p=0,-35`, "exact");
    await page.locator("#surface").focus();
    await page.keyboard.press("Enter");
    const marked = ((await fragment(page)).x ?? "").split(",").map(Number);
    assert.ok((marked[0] ?? 0) > 0 && (marked[0] ?? 0) < 40, marked.join());
    await page.locator(".surfaces button", { hasText: "Whole" }).click();
    await page.waitForSelector('#surface[data-surface="whole"]');
    assert.equal((await fragment(page)).f, undefined);
    assert.deepEqual(troubles, []);
    await close();
  },
);

test(
  "the page draws the inner discs of the flat map as the server does, and points are found on them",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, close } = await loadedPage("&d=8&l=map&i=1");
    await page.waitForSelector(".flat-map[data-way=page][data-inner=true][data-known]");
    const share = await mapAgrees(page, server.address, id);
    console.log(`four discs: ${share}`);
    assert.ok(share >= 0.99, `${share}`);
    // The middles of the inner discs, below: the left half on the left.
    const box = await page.locator(".flat-map .map-image").boundingBox();
    assert.ok(box);
    // On the side of each half, above the callosum, which is a fence and shows nothing.
    for (const [across, sign] of [
      [0.25, 1],
      [0.75, -1],
    ] as const) {
      await page.mouse.click(box.x + across * box.width, box.y + 0.62 * box.height);
      const [left = 0] = ((await fragment(page)).x ?? "").split(",").map(Number);
      assert.ok(sign * left > 0 && sign * left < 25, `${left}`);
    }
    await keep(page, "flat-map-inner");
    assert.deepEqual(troubles, []);
    await close();
  },
);

test(
  "another view than the server's is seen to be another: the comparison can fail",
  { skip, timeout: 600_000 },
  async () => {
    const { page, close } = await loadedPage();
    await bare(page);
    await show(page, `#${id}&r=exact&d=8&v=right`, "exact");
    const { share } = await agreement(page, await rendered("left", 8, "trace", await canvasSize(page)));
    assert.ok(share < 0.9, String(share));
    await close();
  },
);

test(
  "a depth changes with no request, and costs no more script than any frame",
  { skip, timeout: 600_000 },
  async () => {
    const { page, close } = await loadedPage();
    await show(page, `#${id}&r=mesh&d=8`, "mesh");
    const requests: string[] = [];
    page.on("request", (request) => requests.push(request.url()));
    await page.focus("#surface");
    await page.keyboard.press("Shift+F");
    for (let press = 0; press < 10; press += 1) {
      await page.keyboard.press("]");
      await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
    }
    await page.waitForFunction(() => document.querySelector<HTMLElement>("#surface")?.dataset.depth === "13");
    assert.match((await page.textContent(".frame-times")) ?? "", /^Frame [\d.,]+ ms · script [\d.]+ ms · \d+ frames$/);
    const [times, named] = [
      await page.locator(".frame-times").boundingBox(),
      await page.locator("#surface .overlay:not(.other) .pane-case").boundingBox(),
    ];
    assert.ok(times && named && times.y >= named.y + named.height, "the case stays named");
    // The list of cases and the findings of others are asked for now and then.
    assert.deepEqual(
      requests.filter((url) => url.includes(id) && !url.endsWith("/findings")),
      [],
    );
    console.log(`frame times while peeling (mesh, software): ${await page.textContent(".frame-times")}`);
    await close();
  },
);

const of_program = skip || (process.env.ISOCORTEX_PAGE ? "the page is not sent by the program" : false);
test("the first picture needs at most 312 kB besides the quick volume", { skip: of_program }, async () => {
  const { page, context } = await openPage(browser, { viewport: VIEWPORT });
  const session: CDPSession = await context.newCDPSession(page);
  await session.send("Network.enable");
  const urls = new Map<string, string>();
  const bytes = new Map<string, number>();
  session.on("Network.requestWillBeSent", ({ requestId, request }) => urls.set(requestId, request.url));
  session.on("Network.dataReceived", ({ requestId, encodedDataLength }) => {
    const url = urls.get(requestId) ?? "";
    bytes.set(url, (bytes.get(url) ?? 0) + encodedDataLength);
  });
  // The rest is held back, so that what was needed is what was fetched.
  await page.route(/(bits=16|\/distance$|\/mesh\/paths)/, () => {});
  await page.goto(`${server.address.split("#")[0]}#${id}`);
  await page.waitForFunction(
    () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.frames !== undefined,
    null,
  );
  const first_ms = await page.evaluate(() => performance.now());
  const isQuick = (url: string): boolean => url.includes("bits=8");
  const sum = [...bytes].filter(([url]) => !isQuick(url)).reduce((before, [, count]) => before + count, 0);
  const quick = [...bytes].filter(([url]) => isQuick(url)).reduce((before, [, count]) => before + count, 0);
  console.log(
    `to the first picture: ${sum} bytes besides ${quick} of the quick volume;` +
      ` ${first_ms.toFixed(0)} ms after the page began`,
  );
  assert.ok(quick > 0 && sum > 0 && sum <= 312_000, String(sum));
  await context.close();
});

test(
  "the load can be cancelled; what is there stays, and other depths still come",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, { viewport: VIEWPORT });
    await page.route(/(bits=16|\/distance$|\/mesh\/paths)/, () => {});
    await page.goto(`${server.address.split("#")[0]}#${id}`);
    await page.waitForFunction(
      () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.frames !== undefined,
      null,
    );
    await page.click(".cancel-load");
    await page.waitForFunction(
      () => document.querySelector<HTMLElement>(".cancel-load")?.closest<HTMLElement>("[hidden]") !== null,
    );
    // Eight bits, and light from every fourth depth: not the same picture, but nowhere another one.
    await bare(page);
    await keep(page, "first-picture");
    const { share_of_lit } = await agreement(
      page,
      await rendered("left", 10, "mesh", await canvasSize(page)),
      undefined,
      24,
    );
    console.log(`first picture within 24/255 of the server's: ${(100 * share_of_lit).toFixed(2)} % of the lit pixels`);
    assert.ok(share_of_lit >= 0.99, String(share_of_lit));
    await bare(page, false);
    await page.focus("#surface");
    await page.keyboard.press("]");
    await page.waitForFunction(() => document.querySelector<HTMLElement>("#surface")?.dataset.depth === "10.5");
    assert.equal(await page.evaluate(() => document.querySelector<HTMLElement>(".viewer")?.dataset.way), "mesh");
    assert.match((await page.textContent(".loading-line")) ?? "", /Loading was cancelled/);
    // The new depth has been read out, so that it does not come after what the click is answered with.
    await page.waitForSelector(".viewer[data-rested=true]");
    await page.dblclick("#surface");
    assert.match((await page.textContent("#live")) ?? "", /is not known until the rest is loaded/);
    await page.unroute(/(bits=16|\/distance$|\/mesh\/paths)/);
    await page.click(".load-again");
    await page.waitForFunction(
      () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.complete === "true",
      null,
    );
    assert.equal(await page.locator(".load-again").isVisible(), false);
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test(
  "a lost context is said, the server draws, and a restored one draws again by itself",
  { skip, timeout: 600_000 },
  async () => {
    const { page, close } = await loadedPage();
    await bare(page);
    await page.evaluate(() => {
      const canvas = document.querySelector<HTMLCanvasElement>("canvas.cortex");
      const handle = canvas?.getContext("webgl2")?.getExtension("WEBGL_lose_context");
      (globalThis as unknown as { handle: unknown }).handle = handle;
      handle?.loseContext();
    });
    await page.waitForSelector(".viewer[data-fallback=context-lost][data-way=server]");
    // An opaque canvas is white where its context is gone.
    assert.equal(await page.locator("canvas.cortex").isVisible(), false);
    await page.waitForSelector(".surface-host img");
    await keep(page, "context-lost");
    await page.evaluate(() => (globalThis as unknown as { handle: WEBGL_lose_context }).handle.restoreContext());
    await page.waitForSelector(".viewer[data-fallback=''][data-way=exact]");
    assert.equal(await page.locator(".surface-host img").count(), 0);
    for (const [way, renderer] of [
      ["exact", "trace"],
      ["mesh", "mesh"],
    ] as const) {
      await show(page, `#${id}&r=${way}&d=12&v=superior`, way);
      const { share } = await agreement(page, await rendered("superior", 12, renderer, await canvasSize(page)));
      assert.ok(share >= 0.99, `${way}: ${share}`);
    }
    await close();
  },
);

test(
  "?renderer=server draws nothing here: small pictures while dragging, full ones on release",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, { viewport: VIEWPORT });
    const widths: number[] = [];
    page.on("request", (request) => {
      const width = /\/render\?.*width=(\d+)/.exec(request.url())?.[1];
      if (width) widths.push(Number(width));
    });
    await page.goto(`${new URL("/?renderer=server", server.address)}#${id}`);
    await page.waitForSelector(".viewer[data-way=server] .surface-host img");
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    const full = Math.round(box.width);
    widths.length = 0;
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    for (let step = 1; step <= 5; step += 1)
      await page.mouse.move(box.x + box.width / 2 + 12 * step, box.y + box.height / 2);
    await page.waitForFunction(
      () => (document.querySelector<HTMLImageElement>(".surface-host img")?.naturalWidth ?? 9999) < 400,
    );
    await page.mouse.up();
    await page.waitForFunction(
      (width) => document.querySelector<HTMLImageElement>(".surface-host img")?.naturalWidth === width,
      full,
    );
    assert.ok(
      widths.some((width) => width < full),
      String(widths),
    );
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("without WebGL2 the page says so and goes on", { skip, timeout: 600_000 }, async () => {
  const { page, context } = await openPage(browser, { viewport: VIEWPORT });
  await page.addInitScript(() => {
    const original = HTMLCanvasElement.prototype.getContext as (
      this: HTMLCanvasElement,
      kind: string,
      ...rest: unknown[]
    ) => unknown;
    HTMLCanvasElement.prototype.getContext = function (this: HTMLCanvasElement, kind: string, ...rest: unknown[]) {
      return kind === "webgl2" ? null : original.call(this, kind, ...rest);
    } as typeof HTMLCanvasElement.prototype.getContext;
  });
  await page.goto(`${server.address.split("#")[0]}#${id}`);
  await page.waitForSelector(".viewer[data-fallback=no-webgl2][data-way=server] .surface-host img");
  await keep(page, "no-webgl2");
  await context.close();
});

test("a device too small for the volume is said to be, and the page goes on", { skip, timeout: 600_000 }, async () => {
  const { page, troubles, context } = await openPage(browser, { viewport: VIEWPORT });
  await page.addInitScript(() => {
    const original = WebGL2RenderingContext.prototype.getParameter as (
      this: WebGL2RenderingContext,
      name: number,
    ) => unknown;
    WebGL2RenderingContext.prototype.getParameter = function (this: WebGL2RenderingContext, name: number) {
      return name === this.MAX_3D_TEXTURE_SIZE ? 128 : original.call(this, name);
    };
  });
  await page.goto(`${server.address.split("#")[0]}#${id}`);
  await page.waitForSelector(".viewer[data-fallback=too-large][data-way=server] .surface-host img");
  assert.match(await page.locator(".notices").innerText(), /too large for this graphics device/);
  await page.focus("#surface");
  await page.keyboard.press("]");
  await page.waitForSelector("#surface[data-depth='10.5']");
  assert.deepEqual(troubles, []);
  await context.close();
});

test(
  "over 4G the first picture comes long before the rest, whose bytes are counted to the end",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, { viewport: VIEWPORT });
    const session = await context.newCDPSession(page);
    await session.send("Network.enable");
    // 9 Mbit/s, 60 ms.
    await session.send("Network.emulateNetworkConditions", {
      offline: false,
      latency: 60,
      downloadThroughput: 9e6 / 8,
      uploadThroughput: 3e6 / 8,
    });
    const asked: string[] = [];
    page.on("requestfinished", (request) => asked.push(request.url()));
    await page.goto(`${server.address.split("#")[0]}#${id}`);
    await page.waitForSelector("#surface[data-drawn=true]");
    assert.equal(await page.locator(".viewer[data-loaded=true]").count(), 0, "the rest is on its way");
    assert.deepEqual(
      asked.filter((url) => /bits=16|distance$|mesh\/paths/.test(url)),
      [],
    );
    await page.waitForFunction(() =>
      /^Volume and depths: [\d.]+ of [\d.]+ MB/.test(document.querySelector(".loading-line")?.textContent ?? ""),
    );
    const before = await page.locator("#surface").boundingBox();
    // While it comes, the picture is turned and peeled.
    await page.focus("#surface");
    await page.keyboard.press("]");
    await page.waitForSelector("#surface[data-depth='10.5']");
    await page.waitForSelector(".viewer[data-loaded=true]");
    assert.equal(await page.locator(".loading-line").isVisible(), false);
    assert.deepEqual(await page.locator("#surface").boundingBox(), before, "nothing has moved");
    await page.waitForSelector("canvas.cortex[data-complete=true]");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("the mirrored half is the mirror image of the other hemisphere", { skip, timeout: 600_000 }, async () => {
  const { page, close } = await loadedPage();
  await bare(page);
  const shown = (await (await fetch(new URL(`v1/cases/${id}`, server.address))).json()) as Pick<
    ReadyCase,
    "midsagittal" | "envelope_sphere"
  >;
  assert.ok(shown.midsagittal);
  const { orientation, pan_mm } = mirrored(
    { orientation: NAMED_VIEWS.left, zoom: 1, pan_mm: [0, 0] },
    shown.midsagittal,
    shown.envelope_sphere,
  );
  const [turned, moved] = [orientation.map((part) => part.toFixed(9)), pan_mm.map((part) => part.toFixed(6))];
  const across = `orientation=${turned}&pan=${moved}`;
  for (const [way, renderer] of [
    ["exact", "trace"],
    ["mesh", "mesh"],
  ] as const) {
    await show(page, `#${id}&r=${way}&d=10&v=left&l=mirror`, way);
    // The pane of two halves is higher where the window is narrow.
    const [width, height] = await canvasSize(page);
    const half = Math.floor(width / 2);
    const left = await agreement(page, await rendered("left", 10, renderer, [half, height]), {
      left: 0,
      width: half,
      is_flipped: false,
    });
    const right = await agreement(
      page,
      (await rendered("left", 10, renderer, [half, height])).replace("view=left", across),
      { left: width - half, width: half, is_flipped: true },
    );
    // Neither is the other: the brain is not symmetrical.
    const plain = await agreement(page, await rendered("left", 10, renderer, [half, height]), {
      left: width - half,
      width: half,
      is_flipped: false,
    });
    console.log(`mirror, ${way}: ${[left, right, plain].map(({ share }) => (100 * share).toFixed(2)).join(", ")}`);
    assert.ok(left.share >= 0.99 && right.share >= 0.99, `${way}: ${left.share}, ${right.share}`);
    assert.ok(plain.share < 0.95, `${way}: ${plain.share}`);
  }
  await keep(page, "mirror");
  await close();
});

/** The served depths, to be asked anywhere. */
async function servedDepths(): Promise<(position: readonly number[]) => number> {
  const answer = await fetch(new URL(`v1/cases/${id}/distance`, server.address));
  const numbers = (name: string): number[] => (answer.headers.get(`x-isocortex-${name}`) ?? "").split(",").map(Number);
  const [[nx = 0, ny = 0, nz = 0], [scale = 0], affine] = [
    numbers("size"),
    numbers("scale"),
    numbers("patient-from-voxel"),
  ];
  const values = new Int16Array(await answer.arrayBuffer());
  const [side = 1, ...offset] = [affine[0] ?? 1, affine[3] ?? 0, affine[7] ?? 0, affine[11] ?? 0];
  return (position) => {
    const place = position.map((coordinate, axis) => (coordinate - (offset[axis] ?? 0)) / side);
    const [x = 0, y = 0, z = 0] = place.map(Math.floor);
    if ([x, y, z].some((low, axis) => low < 0 || low + 1 >= ([nx, ny, nz][axis] ?? 0))) return -1;
    let depth = 0;
    for (let corner = 0; corner < 8; corner += 1) {
      const at = [corner & 1, (corner >> 1) & 1, corner >> 2];
      const weight = [x, y, z].reduce((product, low, axis) => {
        const share = (place[axis] ?? 0) - low;
        return product * (at[axis] ? share : 1 - share);
      }, 1);
      depth += weight * (values[x + (at[0] ?? 0) + nx * (y + (at[1] ?? 0) + ny * (z + (at[2] ?? 0)))] ?? 0);
    }
    return depth * scale;
  };
}

test(
  "a double click finds the point of the isosurface that is seen there, to a fraction of a millimetre",
  { skip, timeout: 600_000 },
  async () => {
    const { page, close } = await loadedPage("&d=10&v=left");
    const depth = await servedDepths();
    const { envelope_sphere: sphere } = await facts();
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    const mm_per_pixel = (2 * sphere.radius_mm) / Math.min(box.width, box.height);
    for (const [right, down] of [
      [0, 0],
      [-90, 20],
      [60, -60],
      [100, 30],
    ] as const) {
      await page.mouse.dblclick(box.x + box.width / 2 + right, box.y + box.height / 2 + down);
      const found = (await fragment(page)).x?.split(",").map(Number) ?? [];
      // From the left: anterior is at the picture's left. The first depth of 10 mm along the line of sight, in tiny
      // steps.
      const [cx, cy, cz] = sphere.center_in_patient;
      const [y, z] = [cy + right * mm_per_pixel, cz - down * mm_per_pixel];
      let x = cx + sphere.radius_mm;
      while (x > cx - sphere.radius_mm && depth([x, y, z]) < 10) x -= 0.02;
      const off = Math.hypot((found[0] ?? 0) - x, (found[1] ?? 0) - y, (found[2] ?? 0) - z);
      assert.ok(off < 0.5, `${found} is ${off} mm from ${[x, y, z]}`);
    }
    await page.waitForSelector("svg.chart");
    await keep(page, "profile");
    await close();
  },
);

test(
  "what rests is exact on any device; a slow one draws the mesh while the head is turned",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles, context } = await openPage(browser, { viewport: { width: 900, height: 700 } });
    await page.goto(`${server.address.split("#")[0]}#${id}&d=8`);
    const drawn = (way: string): Promise<unknown> =>
      page.waitForFunction((wanted) => {
        const canvas = document.querySelector<HTMLElement>("canvas.cortex");
        const way_now = document.querySelector<HTMLElement>(".viewer")?.dataset.way;
        return canvas?.dataset.complete === "true" && way_now === wanted;
      }, way);
    await drawn("exact");
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    // The first frames are no measure of a device.
    for (const x of [10, 20, 30]) {
      await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
      await page.mouse.down();
      await page.mouse.move(box.x + box.width / 2 + x, box.y + box.height / 2);
      await page.mouse.up();
      await drawn("exact");
      await page.waitForSelector("canvas.cortex[data-quality=full]");
    }
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 2 - 40, box.y + box.height / 2, { steps: 3 });
    await drawn("mesh");
    await page.mouse.up();
    await drawn("exact");
    await page.waitForSelector("canvas.cortex[data-quality=full]");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("the page's memory, textures included, stays below 150 MB", { skip, timeout: 600_000 }, async () => {
  const { page, close } = await loadedPage();
  const session = await page.context().newCDPSession(page);
  await session.send("HeapProfiler.collectGarbage");
  const usage = (await session.send("Runtime.getHeapUsage")) as { usedSize: number; backingStorageSize?: number };
  // On the device: 2 bytes of intensity a voxel, 8 of depth, smoothed depth and slopes; the picture, its samples
  // and depths.
  const voxels = async (asset: string): Promise<number> => {
    const answer = await fetch(new URL(`v1/cases/${id}/${asset}`, server.address), { method: "HEAD" });
    return (answer.headers.get("x-isocortex-size") ?? "")
      .split(",")
      .map(Number)
      .reduce((product, side) => product * side, 1);
  };
  const [width, height] = await canvasSize(page);
  const device = 2 * (await voxels("volume")) + 8 * (await voxels("distance")) + 40 * width * height;
  const megabytes = (count: number): string => `${(count / 1e6).toFixed(1)} MB`;
  const bytes = usage.usedSize + (usage.backingStorageSize ?? 0) + device;
  console.log(
    `heap ${megabytes(usage.usedSize)}, array buffers ${megabytes(usage.backingStorageSize ?? 0)}, ` +
      `on the device ${megabytes(device)}`,
  );
  assert.ok(device > 1e6);
  assert.ok(usage.backingStorageSize !== undefined && bytes < 150e6, String(bytes));
  await close();
});
