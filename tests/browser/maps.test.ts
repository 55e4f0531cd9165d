// The maps over the pictures: drawn here and by the server, switched, waited for, and the list of places to look at.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import {
  type MapName,
  MAP_NAMES,
  firstOverlay,
  overlayPairs,
  overlayText,
  styleOfMap,
} from "../../web/src/model/maps.ts";
import { NAMED_VIEWS, mirrored } from "../../web/src/model/camera.ts";
import type { MirrorPlane, Sphere } from "../../web/src/model/case.ts";
import { violations } from "./axe.ts";
import { agreement, bare, canvasSize, show } from "./pixels.ts";
import {
  COARSE,
  type Server,
  type Stage,
  type Watched,
  findingsOf,
  fragment,
  keep,
  openMenu,
  openPage,
  readyCase,
  shown,
  skip,
  speak,
  startStage,
  until,
} from "./support.ts";

const MESH = "contours=80&points=50";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;
let window_words: string;
/** Whether the head has maps: a phantom has none. */
let has_maps = false;

interface Facts {
  readonly midsagittal: MirrorPlane;
  readonly envelope_sphere: Sphere;
  readonly intensity: { readonly window: { readonly center: number; readonly width: number } };
  readonly maps: { readonly state: string; readonly reason?: string };
}

const facts = async (): Promise<Facts> =>
  (await (await fetch(new URL(`v1/cases/${id}`, server.address))).json()) as Facts;

before(
  async () => {
    if (skip) return;
    stage = await startStage("demo");
    ({ server, browser } = stage);
    id = await readyCase(server.address);
    const { maps, intensity } = await until(facts, (now) => now.maps.state !== "making", 240);
    window_words = `${intensity.window.center},${intensity.window.width}`;
    has_maps = maps.state === "ready";
    if (!has_maps) console.error(`SKIPPED: the head has no maps: ${maps.reason}`);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

async function opened(rest: string, options: Parameters<typeof openPage>[1] = COARSE, query = ""): Promise<Watched> {
  const watched = await openPage(browser, options);
  await watched.page.goto(`${new URL(`/${query}`, server.address)}#${id}${rest}`);
  return watched;
}

/** What of the mirrored half with a map is not the mirror image of the server's picture of the other side. */
async function mirroredOnes(page: Page, table: string[]): Promise<string[]> {
  const { midsagittal, envelope_sphere } = await facts();
  const { orientation, pan_mm } = mirrored(
    { orientation: NAMED_VIEWS.left, zoom: 1, pan_mm: [0, 0] },
    midsagittal,
    envelope_sphere,
  );
  const overlay = { ...firstOverlay("asymmetry"), threshold: 0.5 };
  await show(page, `#${id}&r=exact&d=10&v=left&l=mirror&b=${overlayText(overlay)}`, "exact");
  // The pane of two halves is higher where the window is narrow.
  const [width, height] = await canvasSize(page);
  const half = Math.floor(width / 2);
  const address = `/v1/cases/${id}/render?${new URLSearchParams([
    ...overlayPairs(overlay).map((pair) => [...pair]),
    ["depth_mm", "10"],
    ["renderer", "trace"],
    ["window", window_words],
    ["width", String(half)],
    ["height", String(height)],
  ])}`;
  const across = `&orientation=${orientation.map((part) => part.toFixed(9))}&pan=${pan_mm.map((part) => part.toFixed(6))}`;
  const own = await agreement(page, `${address}&view=left`, { left: 0, width: half, is_flipped: false });
  const other = await agreement(page, address + across, { left: width - half, width: half, is_flipped: true });
  table.push(`mirror: ${own.share_of_lit.toFixed(4)} and, mirrored, ${other.share_of_lit.toFixed(4)}`);
  return own.share_of_lit < 0.99 || other.share_of_lit < 0.99 ? [table.at(-1) ?? ""] : [];
}

/** Those of a case without a FLAIR. */
const OWN_MAPS = MAP_NAMES.filter((name) => name !== "flair");

/** Waits until a map, or none, is seen on the surface. */
const seen = (page: Page, name: MapName | ""): Promise<unknown> =>
  page.waitForSelector(`#surface[data-overlay="${name}"]`);

const status = (page: Page): Promise<string | null> => page.textContent("#maps-status");

test("the page shows maps by default as the server does", { skip }, async () => {
  const { layers } = (await (await fetch(new URL(`v1/cases/${id}/layers`, server.address))).json()) as {
    layers: { name: MapName; unit: string; window: unknown; colormap: string; threshold?: number; opacity: number }[];
  };
  assert.deepEqual(layers.map(({ name }) => name).sort(), [...OWN_MAPS].sort());
  for (const { name, unit, window, colormap, threshold, opacity } of layers) {
    assert.deepEqual({ unit, window, colormap, threshold: threshold ?? null }, styleOfMap(name), name);
    assert.equal(opacity, firstOverlay(name).opacity);
  }
});

test(
  "the page's pictures with a map are the server's: 99 % of what is lit within 4/255, both ways, and mirrored",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("&r=exact", { viewport: { width: 600, height: 800 } });
    await page.waitForFunction(
      () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.complete === "true",
      null,
    );
    await bare(page);
    const size = await canvasSize(page);
    const table = ["share of lit pixels within 4/255 of the server's, and of its picture without the map"];
    const poor: string[] = [];
    // Each map from each side, and each side in each way.
    const sides = [
      ["left", 10],
      ["superior", 16],
    ] as const;
    for (const [way, renderer, from] of [
      ["exact", "trace", 0],
      ["mesh", "mesh", 1],
    ] as const) {
      for (const [number, name] of OWN_MAPS.entries()) {
        const first = firstOverlay(name);
        // Nearly all of a map is seen, and every part of its colours.
        const overlay = { ...first, threshold: first.threshold === null ? null : 0.5, opacity: 0.9 };
        for (const [view, depth_mm] of sides.filter((_, side) => (number + side) % 2 === from)) {
          await show(page, `#${id}&r=${way}&d=${depth_mm}&v=${view}&b=${overlayText(overlay)}`, way);
          // The first frame may come before the map's voxels.
          await seen(page, name);
          await page.waitForSelector("canvas.cortex[data-quality=full]");
          await page.evaluate(
            () => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))),
          );
          const mesh = renderer === "mesh" ? `&${MESH}` : "";
          const plain =
            `/v1/cases/${id}/render?depth_mm=${depth_mm}&view=${view}&renderer=${renderer}${mesh}` +
            `&window=${window_words}&width=${size[0]}&height=${size[1]}`;
          const address = `${plain}&${new URLSearchParams(overlayPairs(overlay).map((pair) => [...pair]))}`;
          const alike = await agreement(page, address);
          const without = await agreement(page, plain);
          const words = `${way} ${name} ${view}: ${alike.share_of_lit.toFixed(4)}, ${without.share_of_lit.toFixed(4)}`;
          table.push(words);
          // The map is seen, and it is the server's.
          if (alike.share_of_lit < 0.99 || without.share_of_lit > alike.share_of_lit - 0.01) poor.push(words);
        }
      }
    }
    poor.push(...(await mirroredOnes(page, table)));
    console.log(table.join("\n"));
    assert.deepEqual(poor, []);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "a map is switched on by its button and its key, undone, and kept in the address; slices and legend follow",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("&l=slices");
    const slices: string[] = [];
    page.on("request", (request) => {
      if (request.url().includes("/slices/")) slices.push(request.url());
    });
    await shown(page);
    await page.getByRole("button", { name: "Blur", exact: true }).click();
    await seen(page, "blur");
    for (const plane of ["axial", "coronal", "sagittal"])
      await page.waitForSelector(`.slice.${plane}[data-overlay=blur]`);
    assert.ok(slices.some((url) => url.includes("overlay=blur") && url.includes("overlay_threshold=2.5")));
    assert.equal((await fragment(page)).b, "blur");
    // How slantwise the cuts meet the junction: a bar for each band of depths, that of 10 mm marked.
    const list = (await (await fetch(new URL(`v1/cases/${id}/layers`, server.address))).json()) as {
      junction_by_depth: { from_mm: number; to_mm?: number; places: number; slanted_share: number }[];
      junction_poorly_met?: number;
    };
    const { junction_by_depth, junction_poorly_met } = list;
    const bands = junction_by_depth.filter(({ places }) => places > 0);
    await openMenu(page, "slant");
    assert.deepEqual(
      await page
        .locator("#menu-slant meter")
        .evaluateAll((bars: HTMLMeterElement[]) => bars.map((bar) => bar.ariaLabel)),
      bands.map(({ from_mm, to_mm, slanted_share }) => {
        const depths = to_mm === undefined ? `> ${from_mm} mm` : `${from_mm} – ${to_mm} mm`;
        return `${depths}: ${Math.round(100 * slanted_share)} %`;
      }),
    );
    const total = junction_poorly_met === undefined ? "" : `${Math.round(100 * junction_poorly_met)} % of the cortex`;
    assert.ok((await page.locator("#menu-slant .poorly-met").innerText()).startsWith(total));
    assert.match(await page.locator("#menu-slant [aria-current=true]").innerText(), /10 – 15 mm/);
    assert.equal(await page.locator("#surface .map-bar").innerText(), "Blur, z\n5.0\n2.5");
    assert.match((await page.textContent("#live")) ?? "", /Blur|Places that stand out/);
    await keep(page, "map-blur-slices");

    await openMenu(page, "maps");
    await page.locator("#map-threshold").fill("4");
    await page.locator("#map-opacity").fill("0.5");
    assert.equal((await fragment(page)).b, "blur,4,0.5");
    await page.waitForFunction(() => document.querySelector("#surface .map-bar")?.textContent?.includes("4.0"));

    await page.focus("#surface");
    await page.keyboard.press("a");
    await seen(page, "asymmetry");
    assert.equal((await fragment(page)).b, "asymmetry");
    await page.keyboard.press("Control+z");
    await seen(page, "blur");
    assert.equal((await fragment(page)).b, "blur,4,0.5");
    await page.keyboard.press("u");
    await seen(page, "");
    assert.equal((await fragment(page)).b, undefined);
    assert.equal(await page.locator("#surface .map-bar").isVisible(), false);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "a place of the list is turned to, its depth is gone to and it is marked, in any layout",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("&b=blur");
    await shown(page);
    await seen(page, "blur");
    await page.getByRole("button", { name: "List places to look at" }).click();
    await page.waitForSelector(":is(.rows .row-button, .fold):focus");
    await page.locator(".fold").click();
    await page.waitForSelector(".rows li");
    const { candidates } = (await (
      await fetch(new URL(`v1/cases/${id}/candidates?limit=20`, server.address))
    ).json()) as { candidates: { position_in_patient: number[]; depth_mm: number; side: string; score: number }[] };
    assert.equal(await page.locator(".rows li").count(), candidates.length);
    assert.equal(
      await page.locator(".candidates-warning summary").innerText(),
      "Blur: Most of these places are normal.",
    );
    assert.doesNotMatch((await page.textContent(".rows")) ?? "", /lesion|detect/i);
    const rows = await page.locator(".row-button").evaluateAll((all) => all.map((one) => one.clientHeight));
    assert.ok(
      rows.every((height) => height === 40),
      rows.join(),
    );
    assert.equal(await page.locator(".row-button[tabindex='0']").count(), 1, "one stop of the tabulator");
    await page.locator("#surface").dblclick();
    await page.locator(".point .depth").waitFor({ state: "attached" });
    for (const [at, layout] of (["single", "slices", "mirror"] as const).entries()) {
      const wanted = candidates[at];
      assert.ok(wanted);
      const item = page.locator(".rows li").nth(at);
      const dot = item.locator(".dot");
      assert.equal(await dot.getAttribute("aria-label"), "not looked at yet");
      // The whole row is to be clicked on.
      await item.locator(".row-depth").click();
      await page.locator(`.layouts button[value=${layout}]`).click();
      assert.equal(await dot.getAttribute("aria-label"), "looked at");
      const { x, d, l, f } = await fragment(page);
      assert.deepEqual(
        x?.split(",").map(Number),
        wanted.position_in_patient.map((part) => Number(part.toFixed(1))),
      );
      // On the inner side of a half, a place has its depth below that half.
      if (f) assert.ok(Number(d ?? 10) < wanted.depth_mm, `${d} is not less than ${wanted.depth_mm}`);
      else {
        // What was seen where a hand has clicked is not said of the place.
        const said = Number(/[\d.]+/.exec((await page.locator(".point .depth").textContent()) ?? "")?.[0]);
        for (const [told, off] of [
          [said, 0.2],
          [Number(d ?? 10), 0.051],
        ] as const)
          assert.ok(Math.abs(told - wanted.depth_mm) < off, `${told} is not ${wanted.depth_mm}`);
      }
      assert.equal(l, [undefined, "slices", "mirror"][at]);
      const pressed = page.locator(".layouts [aria-pressed=true]");
      assert.equal(await pressed.getAttribute("value"), l ?? "single", "the buttons follow");
      assert.equal(await item.getAttribute("aria-current"), "true");
      assert.match((await item.locator(".row-title").getAttribute("title")) ?? "", new RegExp(wanted.side, "i"));
      await page.waitForSelector("canvas.cortex[data-quality=full]");
      await keep(page, `candidate-${at + 1}`);
    }
    // Why it is listed: four bars of one scale, the widest of which is full; beside them its chart.
    const why = page.locator(".row-details");
    const bars = why.locator(".why-bars meter");
    assert.equal(
      await until(
        () => bars.count(),
        (count) => count === 4,
      ),
      4,
    );
    const shares = await bars.evaluateAll((all) => all.map((one) => (one as HTMLMeterElement).value));
    assert.ok(Math.max(...shares) === 1 && (shares[0] ?? 1) < Math.min(...shares.slice(1)), shares.join());
    await why.locator(".chart").waitFor();
    const [axis, chart] = [
      await why.locator(".chart .tick.middle").last().boundingBox(),
      await why.locator(".chart").boundingBox(),
    ];
    assert.ok(axis && chart && axis.y > chart.y + 0.8 * chart.height, "its depths are written below it");
    assert.deepEqual(await violations(page), []);
    await page.keyboard.press("Control+z");
    assert.equal((await fragment(page)).l, "slices");
    // Keys step through the list, whatever the layout.
    const openRank = async (): Promise<number> =>
      page.locator(".rows li").evaluateAll((all) => all.findIndex((one) => one.ariaCurrent === "true"));
    await page.locator(".row-button").nth(1).click();
    for (const [key, rank] of [
      [".", 2],
      ["Shift+J", 3],
      [",", 2],
    ] as const) {
      await page.keyboard.press(key);
      assert.equal(await until(openRank, (now) => now === rank), rank);
    }
    assert.equal((await fragment(page)).l, "slices");
    // The six views are a row of letters.
    const letters = page.locator(".letters button");
    assert.deepEqual(await letters.allInnerTexts(), ["L", "R", "A", "P", "S", "I"]);
    const tops = await letters.evaluateAll((all) => all.map((one) => one.getBoundingClientRect().top));
    assert.equal(new Set(tops).size, 1, "they are one row");
    // A mark that is set elsewhere closes the place; its chart stands with the point again. The place itself is in the middle of its view.
    await page.keyboard.press("Enter");
    await page.getByRole("button", { name: "Superior", exact: true }).click();
    await page.locator("#surface").press("Enter");
    await why.waitFor({ state: "detached" });
    await page.locator(".panel .group .chart").waitFor();
    // A place that the map leaves out has an outline of its own; the threshold is the reader's.
    await page.waitForSelector('#surface[data-overlay="blur"]');
    for (const [at, { score }] of candidates.entries()) {
      if (at > 0 && at < candidates.length - 1) continue;
      await page.locator(".row-button").nth(at).click();
      assert.equal((await fragment(page)).b, "blur");
      const isOutlined = (): Promise<boolean> =>
        page.locator("#surface > .overlay:not(.other) .cursor .place").isVisible();
      assert.equal(await until(isOutlined, (now) => now === score < 2.5), score < 2.5, `${score}`);
    }
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "maps that are being made are waited for, and why a head has none is told; the picture stands meanwhile",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const watched = await openPage(browser, COARSE);
    const { page, troubles } = watched;
    let told: object = { state: "making" };
    const asked: string[] = [];
    page.on("request", (request) => asked.push(request.url()));
    await page.route(
      (url) => url.pathname === `/v1/cases/${id}/layers`,
      async (route) => {
        const response = await route.fetch();
        const { layers, ...rest } = (await response.json()) as { layers: object[] };
        await route.fulfill({ response, json: { ...rest, layers: layers.map((layer) => ({ ...layer, ...told })) } });
      },
    );
    await page.goto(`${server.address.split("#")[0]}#${id}&b=blur`);
    await shown(page);
    await page.waitForFunction(() => document.querySelector("#maps-status")?.textContent?.includes("being computed"));
    assert.equal(await page.locator("#surface").getAttribute("data-overlay"), "");
    assert.ok(!asked.some((url) => url.includes("overlay=") || url.includes("/layers/")));
    told = { state: "ready" };
    await seen(page, "blur");
    assert.equal(await page.locator("#maps-status").isVisible(), false);

    told = { state: "undefined", reason: "the largest voxel spacing is 4.00 mm" };
    await page.reload();
    await shown(page);
    const words = await until(
      () => status(page),
      (now) => now?.includes("4.00 mm") ?? false,
    );
    assert.equal(words, "This case has no maps: The largest voxel spacing is 4.00 mm.");
    const ask = page.getByRole("button", { name: "List places to look at" });
    assert.ok(await ask.isDisabled());
    assert.equal(await ask.getAttribute("aria-describedby"), "maps-status");
    // Neither does a key light up what is not there.
    await page.focus("#surface");
    await page.keyboard.press("y");
    await page.locator(".note", { hasText: words ?? "" }).waitFor();
    assert.equal((await fragment(page)).b, "blur", "as the address asked");
    // In another language the page has words for the reason by its code.
    told = { ...told, reason_code: "coarse-voxels" };
    await speak(page, "pt-BR");
    await page.waitForFunction(() => document.querySelector("#maps-status")?.textContent?.includes("no máximo 2 mm"));
    await shown(page);
    assert.equal(await page.locator("#surface").getAttribute("data-overlay"), "");
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "places that stand out come first, the others are folded; where none does, the page says what that means",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("");
    let unusual = ["yes", "yes", "borderline"];
    let regions: object = { state: "ok", reasons: [], reason_codes: [] };
    await page.route(/\/candidates\?/, async (route) => {
      const response = await route.fetch();
      const answer = (await response.json()) as { candidates: object[] };
      const candidates = answer.candidates.map((one, at) => ({ ...one, unusual: unusual[at] ?? "no" }));
      const json = { ...answer, candidates, regions, nothing_stands_out: unusual.length === 0 };
      await route.fulfill({ response, json });
    });
    await shown(page);
    const ask = page.getByRole("button", { name: "List places to look at" });
    const places = page.locator(".rows li");
    await ask.click();
    await places.first().waitFor();
    assert.equal(await places.count(), 2);
    assert.match(await places.nth(0).innerText(), / z, high/);
    assert.equal(await page.locator(".nothing").isVisible(), false);
    assert.equal(await page.locator(".regions-doubt").isVisible(), false);
    // Keys stay among those that stand out.
    for (const key of [".", ".", "."]) await page.keyboard.press(key);
    await page.waitForSelector(".rows li:nth-child(2)[aria-current=true]");
    const fold = page.locator(".fold");
    const words = await fold.innerText();
    assert.match(words, /^Blur: Show \d+ places that do not stand out$/);
    await fold.press("Enter");
    assert.equal(await places.count(), 2 + Number(/\d+/.exec(words)?.[0]));
    assert.match(await places.nth(2).innerText(), / z, borderline/);
    assert.equal(await fold.getAttribute("aria-expanded"), "true");
    await fold.click();
    assert.equal(await places.count(), 2);

    // A place is dismissed, and stays so; or it is kept as a finding.
    const judge = (name: string) => page.locator(".row-details").getByRole("button", { name, exact: true });
    await judge("Dismiss").click();
    assert.equal(await places.nth(1).locator(".dot").getAttribute("aria-label"), "dismissed");
    await page.keyboard.press(",");
    await page.waitForSelector(".rows li:nth-child(1)[aria-current=true]");
    await page.keyboard.press("Shift+K");
    assert.equal(await places.nth(0).locator(".dot").getAttribute("aria-label"), "1, kept as a finding");
    // It is written about at once, where the place was; then keys are the picture's again.
    await page.waitForSelector(".finding-label:focus");
    await page.keyboard.press("Escape");
    assert.equal(await page.locator(".finding-label").count(), 1);
    await page.keyboard.press("Shift+J");
    await page.waitForSelector(".rows li:nth-child(2)[aria-current=true][data-judgement=dismissed]");
    await page.keyboard.press("Shift+D");
    await page.keyboard.press("Shift+U");
    await page.waitForSelector(".rows li:nth-child(1)[aria-current=true][data-judgement=kept]");
    assert.equal(await places.count(), 2);
    const stored = () => findingsOf(server, id);
    assert.deepEqual(
      (await until(stored, (list) => list.length === 2)).map(({ from_map, is_dismissed }) => [from_map, is_dismissed]),
      [
        ["blur", true],
        ["blur", false],
      ],
    );
    await page.reload();
    await shown(page);
    await ask.click();
    const dots = (): Promise<(string | null)[]> =>
      page.locator(".rows .dot").evaluateAll((all) => all.map((one) => one.ariaLabel));
    const judged = ["1, kept as a finding", "dismissed"];
    assert.deepEqual(await until(dots, (now) => now.join() === judged.join()), judged);
    // The same button again takes the decision back.
    await page.keyboard.press(".");
    await judge("Dismiss").click();
    assert.equal((await until(stored, (list) => list.length === 1)).length, 1);
    await page.keyboard.press(",");
    await page.waitForSelector(".rows li:nth-child(1)[aria-current=true]");
    // Keeping twice keeps; the bin takes out what may have been written about.
    await judge("Keep").click();
    await page.waitForSelector(".finding-label:focus");
    assert.equal(await page.locator(".rows li[data-judgement=kept]").count(), 1);
    await page.locator(".row-details .icon-button").first().click();
    assert.equal((await until(stored, (list) => list.length === 0)).length, 0);

    unusual = [];
    regions = { state: "review", reasons: ["the volume ends within the cerebellum"], reason_codes: ["cerebellum-cut"] };
    await page.reload();
    await shown(page);
    await page.getByRole("button", { name: "Remove the mark" }).click();
    await ask.click();
    await page.locator(".nothing:visible").waitFor();
    assert.match(await page.locator(".nothing").innerText(), /^Nothing stands out\. This does not exclude a lesion: /);
    assert.equal(
      await page.locator(".regions-doubt").innerText(),
      "The regions of the brain are in doubt: The volume ends within the cerebellum. " +
        "Places in the cerebellum and the brain stem are listed as well.",
    );
    assert.equal(await places.count(), 0);
    await page.focus("#surface");
    await page.keyboard.press(".");
    await until(
      () => page.textContent("#live"),
      (words) => /Nothing stands out/.test(words ?? ""),
    );
    assert.deepEqual(await violations(page), []);
    await keep(page, "nothing-stands-out");
    await speak(page, "pt-BR");
    await page.getByRole("button", { name: "Listar locais para examinar" }).click();
    await page.locator(".nothing:visible").waitFor();
    assert.match(await page.locator(".regions-doubt").innerText(), /O volume termina dentro do cerebelo\./);
    // Thick places are another list, with a request and words of its own.
    const asked = page.waitForRequest(/\/candidates\?.*map=thickness/);
    await page.getByRole("button", { name: "Listar locais com córtex espesso" }).click();
    await asked;
    const thick = page.locator(".nothing:visible").nth(1);
    await thick.waitFor();
    assert.match(await thick.innerText(), /^Nenhum córtex espesso se destaca\. Isso não exclui uma lesão: /);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "a place of the mesial wall is shown where it is seen: on the inner side of its half",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("");
    await page.route(/\/candidates\?/, async (route) => {
      const response = await route.fetch();
      const { candidates, ...rest } = (await response.json()) as { candidates: { unusual: string; side: string }[] };
      // In the cingulate gyrus, in the middle of the head, and deep.
      const [x, y, z] = [-8, 10, 45];
      const deep = { ...candidates[0], position_in_patient: [x, y, z], depth_mm: 32, side: "right", unusual: "yes" };
      await route.fulfill({ response, json: { ...rest, candidates: [deep], nothing_stands_out: false } });
    });
    await shown(page);
    await page.getByRole("button", { name: "List places to look at" }).click();
    await page.locator(".rows li:not([data-id]) .row-depth").first().click();
    // Once the half is here, the mark lies on its surface and nothing is before it.
    await page.locator("#surface .pane-title", { hasText: "Right hemisphere" }).first().waitFor();
    await page.waitForSelector("#surface .overlay:not(.other) .cursor.mark", { state: "attached" });
    const { f, d, l } = await fragment(page);
    assert.deepEqual([f, l], ["right", undefined]);
    assert.ok(Number(d) < 20, `${d} mm below the surface of the half`);
    assert.equal(
      await page.locator("#surface .edge.left:not(.other *)").innerText(),
      "A",
      "seen from the patient's left",
    );
    assert.deepEqual(troubles, []);
    await keep(page, "mesial-place");
    await page.context().close();
  },
);

test(
  "where the server draws, it draws the map too; a saved picture has the map and its legend",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("&b=sharpness", COARSE, "?renderer=server");
    const saturated = async (path: string): Promise<number> =>
      page.evaluate(
        async (base64) => {
          const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
          const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
          const canvas = new OffscreenCanvas(image.width, image.height);
          const drawing = canvas.getContext("2d");
          if (!drawing) return 0;
          drawing.drawImage(image, 0, 0);
          const { data } = drawing.getImageData(0, 0, image.width, image.height);
          let count = 0;
          for (let at = 0; at < data.length; at += 4) {
            const [red = 0, green = 0, blue = 0] = data.subarray(at, at + 3);
            if (Math.max(red, green, blue) - Math.min(red, green, blue) > 60) count += 1;
          }
          return count / (image.width * image.height);
        },
        (await readFile(path)).toString("base64"),
      );
    const saved = async (): Promise<number> => {
      const [download] = await Promise.all([
        page.waitForEvent("download"),
        page.getByRole("button", { name: "Save picture" }).click(),
      ]);
      const path = await download.path();
      return saturated(path);
    };
    await shown(page);
    await seen(page, "sharpness");
    await openMenu(page, "export");
    const coloured = await saved();
    await keep(page, "map-by-server");
    await (await openMenu(page, "maps")).getByRole("button", { name: "None" }).click();
    await seen(page, "");
    await openMenu(page, "export");
    const plain = await saved();
    console.log(`coloured pixels of a saved picture: ${coloured.toFixed(3)} with the map, ${plain.toFixed(3)} without`);
    assert.ok(coloured > plain + 0.05);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "a close-up of a finding shows the map that it was kept from, until the close-up is left",
  { skip, timeout: 600_000 },
  async (context) => {
    if (!has_maps) return context.skip("the head has no maps");
    const { page, troubles } = await opened("&l=both", COARSE, "?renderer=server");
    await shown(page);
    await page.getByRole("button", { name: "List places with a thick cortex" }).click();
    const unfold = page.getByRole("button", { name: /^Thickness: Show \d+ places/ });
    await unfold.waitFor();
    await unfold.click();
    await page.locator(".rows li[data-judgement=''] .row-button").first().click();
    await page.getByRole("button", { name: "Keep", exact: true }).click();
    await page.locator("#findings-status", { hasText: "Stored on the server." }).waitFor();
    // No list is open any more, and others may have kept findings before.
    await page.reload();
    await shown(page);
    await page.locator(".row-button").last().click();
    await page.locator("#surface").focus();
    await page.keyboard.press("z");
    await page.waitForSelector('.closer .slice.here-layer[data-overlay="thickness"]');
    await page.locator("#surface, .closer .slice").last().focus();
    await page.keyboard.press("z");
    await page.waitForSelector("body[data-layout=both]");
    assert.equal((await fragment(page)).b, undefined);
    await page
      .getByRole("button", { name: /^Remove \d/ })
      .last()
      .click();
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);
