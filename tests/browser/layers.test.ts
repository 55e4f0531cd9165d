// Layers in the page: added, listed, shown in grey and in colours as the server shows them, changed and deleted.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, isBrain, markedVolume, nifti } from "./phantom.ts";
import { agreement, bare, canvasSize, show } from "./pixels.ts";
import {
  COARSE,
  type Server,
  type Stage,
  type Watched,
  fragment,
  inSettings,
  keep,
  openPage,
  shown,
  skip,
  speak,
  startStage,
  tab,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

interface Listed {
  readonly id: string;
  readonly name: string;
  readonly kind: string;
  readonly state: string;
  readonly window?: readonly [number, number];
}

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;

const PROBE = { name: "probe", mimeType: "application/octet-stream" };
const wave = (x: number, y: number, z: number): number => Math.sin(x / 7) * Math.cos(y / 11) * Math.sin((z + x) / 9);
/** Another contrast of the same head, on a grid between the case's. */
const FLAIR = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(600 + 300 * wave(x, y, z)) : 0), 0.7);
const PET = nifti((x, y, z) => (isBrain(x, y, z) ? Math.round(4000 + 3900 * wave(y, z, x)) : 0), -0.6);
/** Eight regions. */
const REGIONS = nifti((x, y, z) => (isBrain(x, y, z) ? 1 + (x > 0 ? 1 : 0) + (y > 0 ? 2 : 0) + (z > 0 ? 4 : 0) : 0));
const NOISE = nifti((x, y, z) => Math.abs(Math.round(1000 * Math.sin(x * 12.9 + y * 78.2 + z * 37.7))));

before(
  async () => {
    if (skip) return;
    stage = await startStage("serve");
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() });
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

async function opened(rest: string, options: Parameters<typeof openPage>[1] = COARSE): Promise<Watched> {
  const watched = await openPage(browser, options, "images");
  await watched.page.goto(`${new URL("/", server.address)}#${id}${rest}`);
  await shown(watched.page);
  return watched;
}

const layers = async (): Promise<readonly Listed[]> => {
  const answer = await fetch(new URL(`v1/cases/${id}/layers`, server.address));
  return ((await answer.json()) as { layers: Listed[] }).layers.filter((one) => /^[0-9a-f]{32}$/.test(one.id));
};
const named = async (name: string): Promise<Listed> => {
  const found = (await layers()).find((one) => one.name === name);
  assert.ok(found, name);
  return found;
};

/** Adds files in the page and waits until the server has prepared what they are. */
async function added(page: Page, files: Readonly<Record<string, Buffer>>, transform = "none"): Promise<void> {
  if (!(await page.locator(".layer-form").isVisible())) await page.click(".add-layer > summary");
  const payload = Object.entries(files).map(([name, buffer]) => ({ ...PROBE, name, buffer }));
  await page.setInputFiles("#layer-files", payload);
  await page.selectOption("#layer-transform", transform);
  await page.click(".layer-form button[type=submit]");
  await page.waitForFunction(() => document.querySelector(".layers-note")?.textContent !== "");
}

/** Waits until the list has so many layers, all of them prepared. */
const settled = (page: Page, count: number): Promise<unknown> =>
  page.waitForFunction((wanted) => {
    const items = [...document.querySelectorAll<HTMLElement>(".layers li")];
    return items.length === wanted && items.every((item) => /ready|failed/.test(item.dataset.state ?? ""));
  }, count);
const item = (page: Page, name: string) =>
  page.locator(".layers li").filter({ has: page.locator(`strong:text-is("${name}")`) });
const press = (page: Page, name: string, what: string): Promise<void> =>
  item(page, name).locator(`[data-do=${what}]`).click();
const drawn = (page: Page, part: "layer" | "overlay", value: string): Promise<unknown> =>
  page.waitForSelector(`#surface[data-${part}="${value}"]`);

test(
  "layers are added from files, named by their sequence and never by the file, and shown with how they are placed",
  { skip, timeout: 600_000 },
  async () => {
    const sent: string[] = [];
    const { page, troubles } = await opened("");
    page.on("request", (request) => {
      if (request.method() === "POST") sent.push(request.postData() ?? "");
    });
    await page.locator(".added", { hasText: "There are no layers yet" }).waitFor();
    await added(page, { "Silva_flair.nii": FLAIR, "Silva_pet.nii": PET });
    await settled(page, 2);
    await added(page, {
      "Silva_atlas.nii": REGIONS,
      "names.txt": Buffer.from("1 right back below\n2 left back below\n"),
    });
    await settled(page, 3);
    const found = await layers();
    assert.deepEqual(
      found.map(({ name, kind }) => [name, kind]),
      [
        ["FLAIR", "mr"],
        ["PET", "pet"],
        ["labels", "labels"],
      ],
    );
    assert.ok(sent.length >= 3 && sent.every((body) => !body.includes("Silva")));
    const words = await item(page, "PET").innerText();
    assert.match(words, /placed by its header/i);
    assert.equal(await item(page, "labels").locator("[data-do=grey]").count(), 0);
    await keep(page, "layers-list");
    // The same file again is the same layer.
    await added(page, { "again_flair.nii": FLAIR });
    assert.match((await page.textContent(".layers-note")) ?? "", /already here as “FLAIR”/);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "a layer is shown in grey and in colours by button and key, on slices too, kept in the address and undone",
  { skip, timeout: 600_000 },
  async () => {
    const [flair, pet] = [await named("FLAIR"), await named("PET")];
    const { page, troubles } = await opened("&l=slices");
    await settled(page, 3);
    const plain = await page.locator("#window-center-number").inputValue();
    await press(page, "FLAIR", "grey");
    await drawn(page, "layer", flair.id);
    for (const plane of ["axial", "coronal", "sagittal"])
      await page.waitForSelector(`.slice.${plane}[data-layer="${flair.id}"]`);
    const { y, w } = await fragment(page);
    assert.equal(y, flair.id);
    const [low = 0, high = 0] = flair.window ?? [];
    assert.deepEqual(w?.split(",").map(Number), [(low + high + 1) / 2, high - low + 1]);
    assert.notEqual(await page.locator("#window-center-number").inputValue(), plain);
    assert.match(await page.locator("#surface .colour-bar .layer-title").innerText(), /FLAIR, placed by its header/);
    assert.match((await page.textContent("#live")) ?? "", /FLAIR/);

    await press(page, "PET", "colours");
    await drawn(page, "overlay", pet.id);
    assert.match(await page.locator("#surface .map-bar").innerText(), /PET, placed by its header/);
    await page.locator(".added #map-threshold").fill("3000");
    await page.selectOption("#map-colours", "viridis");
    assert.match((await fragment(page)).b ?? "", new RegExp(`^${pet.id},\\d+,0.6,,,viridis$`));
    await page.waitForSelector(`.slice.axial[data-overlay="${pet.id}"]`);
    await keep(page, "layers-shown");

    await page.focus("#surface");
    await page.keyboard.press("l");
    await drawn(page, "layer", pet.id);
    await page.keyboard.press("l");
    await drawn(page, "layer", "");
    assert.equal(await page.locator("#window-center-number").inputValue(), plain);
    await page.keyboard.press("Control+z");
    await drawn(page, "layer", pet.id);
    const address = page.url();
    await page.goto("about:blank");
    await page.goto(address);
    await shown(page);
    await drawn(page, "layer", pet.id);
    await drawn(page, "overlay", pet.id);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "the profile has the width of the junction on both sides, and a curve of each layer with its own scale, both ways",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles } = await opened("");
    await settled(page, 3);
    // The phantom has no maps: what the server measures of its junction is put into its answer.
    const asked: string[] = [];
    await page.route(
      (url) => url.pathname.endsWith("/profile"),
      async (route) => {
        asked.push(route.request().url());
        const response = await route.fetch();
        const { maps_undefined: _, own, mirrored, ...rest } = (await response.json()) as Record<string, object>;
        const json = {
          ...rest,
          own: { ...own, junction_width: { verdict: "measured", mm: 2.34 } },
          mirrored: { ...mirrored, junction_width: { verdict: "under-1-mm" } },
        };
        await route.fulfill({ response, json });
      },
    );
    await page.locator("#surface").focus();
    await page.keyboard.press("Enter");
    await tab(page, "read");
    await page.waitForSelector(".chart .curve.layer");
    assert.equal(
      await page.textContent(".junction-width"),
      "Width of the grey–white boundary (24 to 38 % too small in folded cortex): 2.3 mm, mirrored under 1 mm",
    );
    assert.equal(await page.locator(".chart .curve.layer.own").count(), 2, "labels have no curve");
    assert.equal(await page.locator(".chart .curve.layer.other").count(), 2);
    const legend = await page.locator(".legend .layer").allTextContents();
    assert.ok(/^FLAIR \(.+\): .+ – .+/.test(legend[0] ?? "") && legend[1]?.startsWith("PET ("), legend.join());
    // Each is as high as the picture, whatever its values are.
    const reach = await page.locator(".chart .curve.layer").evaluateAll((curves) => {
      const ys = (curve: Element): number[] =>
        [...(curve.getAttribute("d") ?? "").matchAll(/[ML][\d.]+ ([\d.]+)/g)].map(([, y]) => Number(y));
      return [curves.slice(0, 2), curves.slice(2)].map((pair) => {
        const all = pair.flatMap(ys);
        return [Math.min(...all), Math.max(...all)];
      });
    });
    assert.deepEqual(reach, [
      [8, 120],
      [8, 120],
    ]);
    // Hover, table and file have the values of the layers too.
    await page.locator(".chart").hover();
    await page
      .locator(".profile-read", { hasText: /mm: .+, mirrored .+ · FLAIR \S+, mirrored \S+ · PET \S+, mirrored/ })
      .waitFor();
    const columns = await page.locator(".as-table th[scope=col]").allTextContents();
    assert.deepEqual(columns.slice(3), ["FLAIR", "FLAIR, Mirrored", "PET", "PET, Mirrored"]);
    await page.locator(".as-table > summary").click();
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      page.getByRole("button", { name: "Save as CSV" }).click(),
    ]);
    const table = (await readFile(await download.path(), "utf8")).split("\r\n").map((line) => line.split(","));
    assert.deepEqual(table[0]?.slice(3, 7), ['"FLAIR"', '"mirrored FLAIR"', '"PET"', '"mirrored PET"']);
    const flairs = table.slice(1, -1).map((cells) => cells[3] ?? "");
    const filled = flairs.filter((cell) => cell !== "").map(Number);
    assert.ok(filled.length > 20 && filled.every((value) => value >= 300 && value <= 900), flairs.join());
    // Another depth is the same point: nothing is asked for again.
    await page.locator("#depth-number").fill("6");
    await page.keyboard.press("Enter");
    await page.waitForSelector(".chart .curve.layer");
    assert.equal(asked.length, 1, asked.join("\n"));
    await page.locator(".profile").scrollIntoViewIfNeeded();
    await keep(page, "profile-layers");
    await speak(page, "pt-BR");
    await page.waitForFunction(() =>
      document.querySelector(".junction-width")?.textContent?.includes("2,3 mm, espelhado menos de 1 mm"),
    );
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "an address without a window means the layer's own, also of a layer that is shown; slices divide as soon as they can",
  { skip, timeout: 600_000 },
  async () => {
    const flair = await named("FLAIR");
    const [low = 0, high = 0] = flair.window ?? [];
    const { page, troubles } = await opened(`&y=${flair.id}&w=500,300`);
    await drawn(page, "layer", flair.id);
    assert.equal((await fragment(page)).w, "500,300");
    await page.evaluate((rest) => (location.hash = rest), `#${id}&y=${flair.id}`);
    await until(
      async () => (await fragment(page)).w ?? "",
      (words) => words !== "" && words !== "500,300",
      30,
    );
    const [center = 0, width = 0] = ((await fragment(page)).w ?? "").split(",").map(Number);
    assert.ok(Math.abs(center - (low + high + 1) / 2) < 1 && Math.abs(width - (high - low + 1)) < 1);
    await page.goto("about:blank");
    // The voxels of the layer come late: until then the server draws the slices, which it cannot divide.
    let release = (): void => {};
    const held = new Promise<void>((resolve) => (release = resolve));
    await page.route(
      (url) => url.pathname.endsWith(`/layers/${flair.id}/volume`),
      async (route) => {
        await held;
        await route.continue();
      },
    );
    await page.goto(`${new URL("/", server.address)}#${id}&y=${flair.id}&l=slices&e=0.5`);
    await page.waitForSelector(`.pane.slice.axial[data-way=server][data-layer="${flair.id}"]`);
    release();
    await page.waitForSelector(`.pane.slice.axial[data-way=page][data-layer="${flair.id}"]`);
    assert.equal(await page.locator(".pane.slice.axial .divider").isVisible(), true);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "axe finds nothing in the list of layers, its form and its dialogs, in both themes and languages",
  { skip, timeout: 600_000 },
  async () => {
    const [flair, pet] = [await named("FLAIR"), await named("PET")];
    const { page, troubles } = await opened(`&y=${flair.id}&b=${pet.id},3000,0.6`);
    for (const language of ["pt-BR", "en"]) {
      await speak(page, language);
      await shown(page);
      await settled(page, 3);
      await drawn(page, "overlay", pet.id);
      await page.click(".add-layer > summary");
      for (const theme of ["light", "dark"]) {
        await inSettings(page, () => page.locator("#theme").selectOption(theme));
        assert.deepEqual(await violations(page), [], `${language} ${theme}`);
        await page.locator(".added").scrollIntoViewIfNeeded();
        await keep(page, `layers-${language}-${theme}`);
      }
      await press(page, "PET", "rename");
      await page.waitForSelector("dialog.ask-text");
      assert.deepEqual(await violations(page), [], `${language} rename`);
      await page.keyboard.press("Escape");
      await page.waitForSelector("dialog", { state: "detached" });
    }
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "the page's pictures with layers are the server's: 99 % of what is lit within 4/255, both ways",
  { skip, timeout: 600_000 },
  async () => {
    const [flair, pet, regions] = [await named("FLAIR"), await named("PET"), await named("labels")];
    const { page, troubles } = await opened("&r=exact", { viewport: { width: 600, height: 800 } });
    await page.waitForFunction(
      () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.complete === "true",
      null,
    );
    await bare(page);
    const [width, height] = await canvasSize(page);
    const [low = 0, high = 0] = flair.window ?? [];
    const window_words = `${(low + high + 1) / 2},${high - low + 1}`;
    const table: string[] = [];
    const poor: string[] = [];
    for (const [way, renderer] of [
      ["exact", "trace"],
      ["mesh", "mesh&contours=80&points=50"],
    ] as const) {
      for (const [what, rest, query] of [
        ["FLAIR in grey", `&y=${flair.id}&w=${window_words}`, `&layer=${flair.id}&window=${window_words}`],
        [
          "PET over FLAIR",
          `&y=${flair.id}&w=${window_words}&b=${pet.id},3000,0.8,1000,7000,viridis`,
          `&layer=${flair.id}&window=${window_words}&overlay=${pet.id}&overlay_threshold=3000&overlay_opacity=0.8` +
            "&overlay_window=1000,7000&overlay_colormap=viridis",
        ],
        [
          "labels over FLAIR",
          `&y=${flair.id}&w=${window_words}&b=${regions.id},,0.6`,
          `&layer=${flair.id}&window=${window_words}&overlay=${regions.id}&overlay_opacity=0.6`,
        ],
      ] as const) {
        await show(page, `#${id}&r=${way}&d=6&v=left${rest}`, way);
        const plain = `/v1/cases/${id}/render?depth_mm=6&view=left&renderer=${renderer}&width=${width}&height=${height}`;
        const alike = await agreement(page, plain + query);
        const without = await agreement(page, plain);
        const words = `${way} ${what}: ${alike.share_of_lit.toFixed(4)}, without ${without.share_of_lit.toFixed(4)}`;
        table.push(words);
        if (alike.share_of_lit < 0.99 || without.share_of_lit > 0.9) poor.push(words);
      }
    }
    console.log(table.join("\n"));
    assert.deepEqual(poor, []);
    assert.deepEqual(troubles, []);
    await page.context().close();
  },
);

test(
  "layers are renamed, moved and, when that is confirmed, deleted, also while one is drawn",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles } = await opened("");
    await settled(page, 3);
    await press(page, "FLAIR", "rename");
    await page.fill("dialog #text", "FLAIR 3D");
    await page.keyboard.press("Enter");
    await item(page, "FLAIR 3D").waitFor();
    await press(page, "FLAIR 3D", "down");
    assert.deepEqual(
      await until(
        async () => (await layers()).map(({ name }) => name),
        ([first]) => first === "PET",
      ),
      ["PET", "FLAIR 3D", "labels"],
    );
    // Another layer has this name.
    await press(page, "PET", "rename");
    await page.fill("dialog #text", "labels");
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => /name/.test(document.querySelector(".layers-note")?.textContent ?? ""));

    const { id: doomed } = await named("labels");
    await press(page, "labels", "colours");
    await drawn(page, "overlay", doomed);
    await press(page, "labels", "delete");
    await page.getByRole("button", { name: "Keep" }).click();
    assert.equal((await layers()).length, 3);
    await press(page, "labels", "delete");
    await page.getByRole("button", { name: "Delete", exact: true }).click();
    await settled(page, 2);
    await drawn(page, "overlay", "");
    assert.equal((await layers()).length, 2);
    // An address can name what is gone.
    await page.goto("about:blank");
    await page.goto(`${new URL("/", server.address)}#${id}&b=${doomed},,0.6`);
    await shown(page);
    await page.waitForFunction(() => /does not exist/.test(document.querySelector(".layers-note")?.textContent ?? ""));
    assert.equal((await fragment(page)).b, undefined);
    assert.deepEqual(
      troubles.filter((words) => !words.includes("status of 409")),
      [],
    );
    await page.context().close();
  },
);

test(
  "what is no layer is refused in words; what fits nowhere says so and is never drawn",
  { skip, timeout: 600_000 },
  async () => {
    const { page } = await opened("");
    await settled(page, 2);
    await page.click(".add-layer > summary");
    await page.click(".layer-form button[type=submit]");
    assert.match((await page.textContent(".layers-note")) ?? "", /Choose a volume first/);
    await added(page, { "flair.nii": Buffer.from("no volume") });
    await until(
      async () => (await page.textContent(".layers-note")) ?? "",
      (words) => words.length > 20,
    );
    assert.equal((await layers()).length, 2);
    await added(page, { "noise.nii": NOISE }, "auto");
    await settled(page, 3);
    const failed = page.locator(".layers li[data-state=failed]");
    assert.equal(await failed.count(), 1);
    assert.match(await failed.innerText(), /could not be registered to this head/);
    assert.equal(await failed.locator("[data-do=grey], [data-do=colours]").count(), 0);
    await keep(page, "layers-failed");
    await page.context().close();
  },
);

test(
  "of several volumes the T1 becomes the case, and those that are wanted its layers; so do other series of DICOM",
  { skip, timeout: 600_000 },
  async () => {
    const { page, troubles } = await opened("");
    if (!(await page.locator("#upload").isVisible())) await page.click("#add > summary");
    const files = { "t1.nii": markedVolume(5), "brain_mask.nii": brainMask(), "flair.nii": FLAIR, "fdg.nii": PET };
    await page.setInputFiles(
      "#upload-volume",
      Object.entries(files).map(([name, buffer]) => ({ ...PROBE, name, buffer })),
    );
    assert.match(await page.locator("#upload .chosen").innerText(), /other volumes: 2/);
    await page.click("#upload button[type=submit]");
    await page.waitForSelector("dialog.offer");
    assert.match(await page.locator("dialog.offer").innerText(), /FLAIR \(flair.nii\)\s+PET \(fdg.nii\)/);
    await keep(page, "layers-offered");
    await page.locator("dialog.offer input").nth(1).uncheck();
    await page.getByRole("button", { name: "Add", exact: true }).click();
    await page.waitForFunction(() =>
      /FLAIR .* was added/.test(document.querySelector("#upload-done")?.textContent ?? ""),
    );
    const { cases } = (await (await fetch(new URL("v1/cases", server.address))).json()) as { cases: { id: string }[] };
    const made = cases.find((one) => one.id !== id)?.id ?? "";
    const list = async (): Promise<readonly Listed[]> => {
      const answer = await fetch(new URL(`v1/cases/${made}/layers`, server.address));
      const { layers: all = [] } = (await answer.json()) as { layers?: Listed[] };
      return all.filter(({ kind, name }) => kind !== "map" || name === "map");
    };
    const found = await until(list, (all) => all.length > 0, 60);
    assert.deepEqual(
      found.map(({ name, kind }) => [name, kind]),
      [["FLAIR", "mr"]],
    );

    // The answer to DICOM lists the other series, each of which is asked for by its token from the same files.
    const wishes: string[] = [];
    await page.route(/\/v1\/cases$/, async (route) => {
      const response = await route.fetch();
      const series = { number: 4, name: "FLAIR", is_volume: true, token: "s4" };
      const others = [
        series,
        { ...series, number: 9, name: "", token: "s9" },
        { ...series, is_volume: false, token: "s1" },
      ];
      await route.fulfill({ response, json: { ...((await response.json()) as object), dicom: { others } } });
    });
    await page.route(/\/layers$/, async (route) => {
      if (route.request().method() !== "POST") return route.continue();
      wishes.push(/\{.*?\}/.exec(route.request().postData() ?? "")?.[0] ?? "");
      const json = { type: "urn:isocortex:problem:busy", detail: "too much work is waiting" };
      await (wishes.length === 1
        ? route.fulfill({ status: 202, json: {} })
        : route.fulfill({ status: 503, contentType: "application/problem+json", json }));
    });
    await page.click("#add > summary");
    await page.setInputFiles("#upload-volume", [
      { ...PROBE, name: "t1.nii", buffer: markedVolume(9) },
      { ...PROBE, name: "mask.nii", buffer: brainMask() },
    ]);
    await page.click("#upload button[type=submit]");
    await page.waitForSelector("dialog.offer");
    assert.match(await page.locator("dialog.offer").innerText(), /FLAIR, series 4\s+MR, series 9/);
    await page.getByRole("button", { name: "Add", exact: true }).click();
    await page.waitForFunction(() => /not added/.test(document.querySelector("#upload-done")?.textContent ?? ""));
    assert.deepEqual(wishes, ['{"series":"s4"}', '{"series":"s9"}']);
    const said = (await page.textContent("#upload-done")) ?? "";
    assert.match(said, /FLAIR, series 4 was added as a layer\. MR, series 9 was not added: Too much work is waiting\./);
    assert.deepEqual(
      troubles.filter((words) => !/status of (409|503)/.test(words)),
      [],
    );
    await page.context().close();
  },
);
