// The list of cases, from upload to deletion, and what goes wrong on the way. The server draws here as well.

import assert from "node:assert/strict";
import { readFile, writeFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import { bare } from "./pixels.ts";
import {
  type Server,
  type Stage,
  type Watched,
  brightest,
  fragment,
  headOfDemo,
  keep,
  openMenu,
  openPage,
  readyCase,
  rested,
  shown,
  skip,
  startServer,
  startStage,
  tab,
  typeDepth,
  until,
} from "./support.ts";

let stage: Stage;
let server: Server;
let browser: Browser;
let watched: Watched;
let page: Page;
let origin: string;

before(
  async () => {
    if (skip) return;
    // The server is started again at its port, which no other test may have taken by then.
    stage = await startStage("serve", async () => ["--keep-days", "3650"], 21_640);
    ({ server, browser } = stage);
    watched = await openPage(browser);
    page = watched.page;
    origin = new URL(server.address).origin;
    await page.goto(`${origin}/?renderer=server`);
  },
  { timeout: 600_000 },
);

after(() => stage?.end());

const row = (state: string): string => `#case-list [data-state=${state}]`;

/** Drops files on the page, as a hand does. */
async function drop(files: readonly { name: string; bytes: Buffer }[]): Promise<void> {
  const packed = files.map(({ name, bytes }) => [name, bytes.toString("base64")] as const);
  await page.evaluate((all) => {
    const transfer = new DataTransfer();
    for (const [name, base64] of all)
      transfer.items.add(new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name));
    for (const type of ["dragover", "drop"])
      document.body.dispatchEvent(new DragEvent(type, { dataTransfer: transfer, bubbles: true, cancelable: true }));
  }, packed);
}

test("an empty server asks for a case; a file that is no volume is refused in words", { skip }, async () => {
  await page.waitForSelector("#add[open]");
  // The empty stage is where files are dropped or chosen.
  const chosen = page.waitForEvent("filechooser");
  await page.locator(".start").getByRole("button", { name: "Choose files" }).click();
  await chosen;
  // On a phone the list does not lie over it.
  const phone = await openPage(browser, { viewport: { width: 390, height: 844 } });
  await phone.page.goto(server.address);
  await phone.page.waitForSelector("body[data-loaded=true]");
  await phone.page.locator(".start").getByRole("button", { name: "Choose files" }).click({ trial: true });
  await phone.context.close();
  assert.match(await page.locator("#cases-note").innerText(), /None yet/);
  // What cannot be a volume is named before anything is sent.
  const report = { name: "report.pdf", mimeType: "application/pdf", buffer: Buffer.from("%PDF") };
  await page.locator("#upload-volume").setInputFiles(report);
  await page.waitForFunction(() => (document.querySelector("#upload-note")?.textContent ?? "") !== "");
  assert.equal(await page.locator(".chosen-names").innerText(), "(report.pdf)");
  const file = path.join(stage.folder, "DOE-JANE.nii");
  await writeFile(file, "this is no NIfTI file");
  await page.locator("#upload-volume").setInputFiles(file);
  await page.locator("#upload button[type=submit]").click();
  const words = await until(
    () => page.locator("#upload-note").innerText(),
    (now) => /nifti/i.test(now) && !/choose/i.test(now),
  );
  assert.doesNotMatch(words, /DOE|status \d/, "neither the file's name nor a bare status");
});

test("a volume and its mask that are dropped become a case, which is shown when it is ready", { skip }, async () => {
  assert.equal(await page.locator(".start").isVisible(), true);
  let sent = "";
  page.on("request", (request) => {
    if (request.method() === "POST") sent = request.postData() ?? "";
  });
  await drop([
    { name: "DOE-JANE-mask.nii", bytes: brainMask() },
    { name: "DOE-JANE.nii", bytes: markedVolume() },
  ]);
  await page.waitForFunction(() =>
    /Volume, 0\.6 MB · mask, 0\.6 MB/.test(document.querySelector(".chosen")?.textContent ?? ""),
  );
  await page.locator("#upload-name").fill("Marked");
  await page.locator("#upload button[type=submit]").click();
  await page.waitForSelector(row("ready"));
  await shown(page);
  assert.doesNotMatch(sent, /DOE/, "the files' names stay here");
  assert.equal(await page.locator("#case-title").innerText(), "Marked");
  assert.doesNotMatch(page.url(), /Marked/);
  await page.waitForSelector(`${row("ready")} .thumb img`);
});

test("a case says when its age removes it, and can be kept", { skip }, async () => {
  const section = page.locator(".panel .group", { has: page.locator("summary", { hasText: "Case and mask" }) });
  const unfold = async (): Promise<void> => {
    if ((await section.getAttribute("open")) === null) await section.locator("summary").first().click();
    await section.locator(".case-facts dt").first().waitFor();
  };
  const removal = section.locator(".case-facts dt", { hasText: "Will be removed" });
  const [{ id } = { id: "" }] = ((await (await fetch(`${origin}/v1/cases`)).json()) as { cases: { id: string }[] })
    .cases;
  const isKept = async (): Promise<boolean> =>
    ((await (await fetch(`${origin}/v1/cases/${id}`)).json()) as { kept: boolean }).kept;
  await tab(page, "case");
  await unfold();
  await removal.waitFor();
  const until = await removal.locator("xpath=following-sibling::dd[1]").innerText();
  assert.match(until, new RegExp(`${new Date(Date.now() + 3650 * 86_400_000).getFullYear()}`));
  const keepCase = section.getByLabel("Keep this case, whatever its age");
  assert.equal(await keepCase.isChecked(), false);
  await keepCase.check();
  await removal.waitFor({ state: "detached" });
  assert.equal(await isKept(), true);
  await keep(page, "kept");
  // The page learns it from the server when it is opened again.
  await page.reload();
  await shown(page);
  await unfold();
  await page.waitForFunction(() => document.querySelector<HTMLInputElement>("#keep-case")?.checked);
  assert.equal(await removal.count(), 0);
  await keepCase.uncheck();
  await removal.waitFor();
  assert.equal(await isKept(), false);
  // Where the server does not answer, the switch stays as it was.
  await page.route(`**/v1/cases/${id}`, (route) =>
    route.request().method() === "PATCH" ? route.fulfill({ status: 400 }) : route.continue(),
  );
  await keepCase.click();
  await page.waitForFunction(() => !document.querySelector<HTMLInputElement>("#keep-case")?.checked);
  await page.unroute(`**/v1/cases/${id}`);
  await removal.waitFor();
  await tab(page, "read");
});

test("a case that waits shows slices of what was acquired, and then its surface", { skip }, async () => {
  // The server would be done before anyone looks: the page is told that it still waits.
  const told = /\/v1\/cases(\/[0-9a-f]+|\/search)?(\?|$)/;
  const waits = (one: Record<string, unknown>): Record<string, unknown> => ({ ...one, state: "queued" });
  await page.route(
    (url) => told.test(url.pathname + url.search),
    async (route) => {
      const response = await route.fetch();
      const answer = (await response.json()) as { cases?: Record<string, unknown>[] };
      const changed = answer.cases
        ? { ...answer, cases: answer.cases.map(waits) }
        : waits(answer as typeof answer & Record<string, unknown>);
      await route.fulfill({ response, json: changed });
    },
  );
  await page.route(/\/events$/, (route) => route.fulfill({ status: 200, body: "" }));
  await page.reload();
  await page.waitForFunction(() => document.querySelectorAll(".acquired img").length === 3);
  assert.equal(await page.locator(".pane.surface").count(), 0, "no surface yet");
  const [axial, coronal, sagittal] = await page.locator(".acquired img").all();
  assert.deepEqual(await Promise.all([axial, coronal, sagittal].map((image) => image?.getAttribute("alt"))), [
    "Axial",
    "Coronal",
    "Sagittal",
  ]);
  await keep(page, "acquired");
  await page.unrouteAll({ behavior: "wait" });
  await page.reload();
  await shown(page);
  assert.equal(await page.locator(".acquired img").count(), 0);
});

test("a doubtful mask is said before the picture, with its reasons", { skip }, async () => {
  // The phantom's brain is too small for a brain.
  assert.match(await page.locator(".quality").innerText(), /Check the mask[\s\S]* ml/);
  assert.equal(await page.locator(`${row("ready")} .quality-badge`).innerText(), "Check the mask");
  await page.locator(".quality button").click();
  await page.waitForSelector("dialog.mask img");
  await page.keyboard.press("Escape");
});

/** Shows what an address says, and waits until the picture and what stands on it are of it. */
async function open(fragment: string, way: "mesh" | "exact" | "server"): Promise<void> {
  const view = /v=(\w+)/.exec(fragment)?.[1] ?? "";
  const query = way === "server" ? "?renderer=server" : "";
  const address = `${origin}/${query}#${fragment}&r=${way === "server" ? "mesh" : way}`;
  await page.goto(address);
  // Where the fragment alone is another one, this is no new page.
  await page.evaluate((hash) => (location.hash = hash), new URL(address).hash);
  await page.waitForFunction(
    ([name, drawn_by]) => {
      const pane = document.querySelector<HTMLElement>("#surface");
      const canvas = document.querySelector<HTMLElement>("canvas.cortex");
      const is_whole =
        drawn_by === "server" || (canvas?.dataset.complete === "true" && canvas.dataset.quality === "full");
      const is_of_view =
        pane?.dataset.depth === "9" && pane.querySelector(".pane-line")?.textContent?.toLowerCase().includes(name);
      return is_whole && is_of_view && document.querySelector<HTMLElement>(".viewer")?.dataset.way === drawn_by;
    },
    [view, way] as const,
  );
  const layout = /l=(\w+)/.exec(fragment)?.[1] ?? "single";
  if (layout === "mirror")
    await page.waitForSelector(way === "server" ? "#surface.halved .server-picture.other img" : "#surface.halved");
  if (layout === "slices") await slicesOf(fragment);
  // What is on the screen is this frame with the next but one.
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
}

/** Waits until the slices are those of an address with a marked point, each with its picture. */
async function slicesOf(fragment: string): Promise<void> {
  const [x, y, z] = /x=([-\d.,]+)/.exec(fragment)?.[1]?.split(",") ?? [];
  await page.waitForFunction(
    ([positions, is_flipped]) => {
      const are_there = Object.entries(positions).every(([plane, position]) => {
        const slice = document.querySelector<HTMLElement>(`.slice.${plane}`);
        return slice?.dataset.depth === "9" && slice.dataset.position === position;
      });
      return are_there && (document.querySelector(".slice.axial .flipped") !== null) === is_flipped;
    },
    [{ sagittal: x, coronal: y, axial: z }, fragment.includes("c=n")] as const,
  );
}

/** Where in a picture the mark is, as a share of its width. */
async function markIn(png: Buffer, what: string): Promise<number> {
  const found = await brightest(page, png, 250);
  assert.ok(found && found.count > 100, `${what}: ${JSON.stringify(found)}`);
  return found.x;
}
const markOf = async (selector: string, what: string): Promise<number> =>
  markIn(await page.locator(selector).screenshot(), what);
const letters = (selector: string): Promise<string[]> =>
  page.locator(`${selector} .overlay:not(.other) .edge`).allInnerTexts();
/** A window in which the mark alone is white, and no light. */
const MARK = "d=9&w=700,300&a=1&";

for (const way of ["server", "mesh", "exact"] as const) {
  test(
    `a mark on the patient's right is on the right side of the surface and of its mirror image (${way})`,
    { skip, timeout: 600_000 },
    async () => {
      const id = await readyCase(server.address);
      for (const [view, is_right_at_left] of [
        ["anterior", true],
        ["posterior", false],
        ["superior", false],
        ["inferior", true],
      ] as const) {
        await open(`${id}&${MARK}v=${view}`, way);
        const [left, right] = await letters("#surface");
        assert.deepEqual([left, right], is_right_at_left ? ["R", "L"] : ["L", "R"], view);
        await bare(page);
        const x = await markOf("#surface > .surface-host", view);
        assert.ok(is_right_at_left ? x < 0.45 : x > 0.55, `${view}: ${x}`);
        await bare(page, false);
      }
      // From the left the mark is on the other side of the head, behind it.
      await open(`${id}&${MARK}v=left`, way);
      await bare(page);
      assert.equal(await brightest(page, await page.locator("#surface > .surface-host").screenshot(), 250), null);
      await bare(page, false);
      await open(`${id}&${MARK}v=left&l=mirror`, way);
      await bare(page);
      const found = await brightest(page, await page.locator("#surface > .surface-host").screenshot(), 250);
      assert.ok(
        found && found.count > 100 && found.least_x > 0.5,
        `the right hemisphere, and it alone, is in the right half: ${JSON.stringify(found)}`,
      );
      await bare(page, false);
    },
  );
}

test(
  "a mark on the patient's right is on the right side of every slice, of the server's picture and of the screenshot",
  { skip, timeout: 600_000 },
  async () => {
    const id = await readyCase(server.address);
    for (const [convention, is_right_at_left] of [
      ["", true],
      ["&c=n", false],
    ] as const) {
      await open(`${id}&${MARK}v=right&x=-38,0,0&l=slices${convention}`, "server");
      for (const plane of ["axial", "coronal"]) {
        const x = await markOf(`.slice.${plane} .slice-image`, plane);
        assert.ok(is_right_at_left ? x < 0.45 : x > 0.55, `${plane}${convention}: ${x}`);
      }
      await markOf(".slice.sagittal .slice-image", "the sagittal slice through the mark");
    }
    await open(`${id}&${MARK}v=right&x=38,0,0&l=slices`, "server");
    const slice = await page.locator(".slice.sagittal .slice-image").screenshot();
    assert.ok(
      ((await brightest(page, slice, 250))?.count ?? 0) < 100,
      "the sagittal slice of the left side has no mark",
    );
    await open(`${id}&${MARK}v=anterior`, "server");
    await openMenu(page, "export");
    await page.getByRole("button", { name: "Picture from the server" }).click();
    await page.waitForSelector("dialog.server-picture img");
    const there = await markOf("dialog.server-picture img", "the server's picture");
    assert.ok(there < 0.45, String(there));
    await page.locator("dialog.server-picture button[value=close]").click();
    const waiting = page.waitForEvent("download");
    await openMenu(page, "export");
    await page.getByRole("button", { name: "Save picture" }).click();
    const saved = await markIn(await readFile(await (await waiting).path()), "the screenshot");
    assert.ok(saved < 0.45, String(saved));
  },
);

test(
  "the depth profile of the mark is bright, and that of the mirrored point is not",
  { skip, timeout: 600_000 },
  async () => {
    const id = await readyCase(server.address);
    await open(`${id}&${MARK}v=right`, "mesh");
    const box = await page.locator("#surface").boundingBox();
    assert.ok(box);
    await page.mouse.dblclick(box.x + box.width / 2, box.y + box.height / 2);
    await page.waitForSelector(".as-table");
    await page.locator(".as-table summary").click();
    const rows = await page.locator(".as-table tbody tr").allInnerTexts();
    const at = (depth_mm: number): number[] =>
      rows
        .map((row) => row.split(/\s+/).map((cell) => Number(cell.replace(",", ""))))
        .find(([depth]) => depth === depth_mm) ?? [];
    const [, own = NaN, other = NaN] = at(8);
    assert.ok(Math.abs(own - 1000) < 20, `${own} in the mark, of ${rows.join("; ")}`);
    assert.ok(Math.abs(other - 300) < 40, `${other} opposite`);
    await page.locator(".as-table summary").click();
  },
);

/** Every text that the list has had since the page began, in order. */
async function notes(): Promise<string[]> {
  return page.evaluate(() => (globalThis as unknown as { notes?: string[] }).notes ?? []);
}

test(
  "files are chosen as well as dropped; a case that is being prepared shows how far it has come, live",
  { skip, timeout: 600_000 },
  async () => {
    const head = headOfDemo();
    const files =
      head.ISOCORTEX_DEMO_VOLUME && head.ISOCORTEX_DEMO_MASK
        ? [head.ISOCORTEX_DEMO_VOLUME, head.ISOCORTEX_DEMO_MASK]
        : await writtenPhantom();
    await page.goto(`${origin}/?renderer=server`);
    await page.waitForSelector("#case-list [data-id]");
    await page.evaluate(() => {
      const all: string[] = ((globalThis as unknown as { notes: string[] }).notes = []);
      const note = document.querySelector("#case-list");
      if (note)
        new MutationObserver(() => all.push(note.textContent ?? "")).observe(note, {
          childList: true,
          characterData: true,
          subtree: true,
        });
    });
    await page.locator("#add > summary").click();
    await page.locator("#upload-volume").setInputFiles(files[0] ?? "");
    await page.locator("#upload-mask").setInputFiles(files[1] ?? "");
    assert.match(await page.locator(".chosen").innerText(), /Volume, .* MB · mask, .* MB/);
    await page.locator("#case-list [data-id]", { hasText: "Marked" }).locator("a").click();
    await shown(page);
    await page.locator(".layouts button[value=slices]").click();
    await page.getByRole("button", { name: "Superior", exact: true }).click();
    await typeDepth(page, 11.5);
    await page.locator("#zoom").fill("1");
    const left = await fragment(page);
    await page.locator("#upload-name").fill("Second");
    await page.locator("#upload button[type=submit]").click();
    const second = page.locator("#case-list [data-id]", { hasText: "Second" });
    await second.and(page.locator("[data-state=ready]")).waitFor();
    assert.deepEqual(await fragment(page), left, "what was shown is shown still");
    assert.match(await page.locator("#upload-done").innerText(), /“Second · .*” was added/);
    assert.equal(await second.locator(".fresh-badge").innerText(), "New");
    await page.waitForFunction(() => document.querySelector("#live")?.textContent === "Second is ready.");
    await keep(page, "fresh-case");
    const shares = (await notes())
      .map((words) => /(\d+)\s%/.exec(words)?.[1])
      .filter((share) => share !== undefined)
      .map(Number);
    assert.ok(
      new Set(shares).size >= 2 && shares.every((share, at) => share >= (shares[at - 1] ?? 0)),
      (await notes()).join("; "),
    );
  },
);

test(
  "a case is left and found again as it was; a new one is seen as the one before",
  { skip, timeout: 600_000 },
  async () => {
    const go = (name: string): Promise<void> =>
      page.locator("#case-list [data-id]", { hasText: name }).locator("a").click();
    const before = await fragment(page);
    assert.deepEqual([before.d, before.v, before.l, before.z], ["11.5", "superior", "slices", "2"]);
    await go("Second");
    await shown(page);
    assert.doesNotMatch((await page.textContent("#live")) ?? "", /is ready/);
    const second = await fragment(page);
    assert.notEqual(second.id, before.id);
    assert.deepEqual([second.d, second.v, second.l, second.z], ["11.5", "superior", "slices", undefined]);
    assert.equal(await page.locator(".fresh-badge:visible").count(), 0, "it is new no more");
    await page.getByRole("button", { name: "Anterior", exact: true }).click();
    await typeDepth(page, 4);
    await rested(page);
    await go("Marked");
    await shown(page);
    assert.deepEqual(await fragment(page), before);
    await go("Marked");
    assert.deepEqual(await fragment(page), before, "a click on the open case changes nothing");
    await go("Second");
    await shown(page);
    const again = await fragment(page);
    assert.deepEqual([again.d, again.v], ["4", "anterior"]);
    await page.keyboard.press("Control+z");
    assert.equal((await fragment(page)).d, "11.5");
    // Back leads to another patient: it is said, which a click in the list is not.
    assert.equal(await page.locator(".notices > .remark").isVisible(), false);
    const went = page.url();
    await page.goto(went.replace(/#.*/, `#${before.id}`));
    await shown(page);
    const said = page.locator(".notices > .remark");
    await said.waitFor({ state: "visible" });
    assert.match(await said.innerText(), /^Another case is shown now: Marked/);
    assert.match((await page.textContent("#live")) ?? "", /^Another case is shown now: Marked/);
    await go("Second");
    await shown(page);
    assert.equal(await page.locator(".notices > .remark").isVisible(), false);
    await page.getByRole("button", { name: "Undo", exact: true }).click();
    assert.equal((await fragment(page)).v, "superior");
    await page.keyboard.press("Control+Shift+z");
    await page.getByRole("button", { name: "Redo", exact: true }).click();
    assert.deepEqual(await fragment(page), again);
    assert.ok(await page.getByRole("button", { name: "Redo", exact: true }).isDisabled());
    await keep(page, "undo");
  },
);

test(
  "slices that are here already are said to be, and are renamed only when asked to",
  { skip, timeout: 600_000 },
  async () => {
    const marked = page.locator("#case-list [data-id]", { hasText: "Marked" });
    const again = async (name: string): Promise<void> => {
      await drop([
        { name: "again-mask.nii", bytes: brainMask() },
        { name: "again.nii", bytes: markedVolume() },
      ]);
      await page.locator("dialog.dropped button[value=case]").click();
      assert.equal(
        await until(
          () => page.locator(".chosen-names").innerText(),
          (names) => names !== "",
        ),
        "again.nii\nagain-mask.nii",
      );
      await page.locator("#upload-name").fill(name);
      await page.locator("#upload button[type=submit]").click();
    };
    await again("");
    await page.waitForFunction(() =>
      /already here as “Marked · added .* · [0-9a-f]{8}”/.test(
        document.querySelector("#upload-done")?.textContent ?? "",
      ),
    );
    assert.equal(await marked.locator(".fresh-badge").innerText(), "Already here");
    await again("Other");
    await page.waitForSelector("dialog.confirm-rename");
    assert.match(
      await page.locator("dialog.confirm-rename p").innerText(),
      /case “Marked · added .* · [0-9a-f]{8}”. Rename it “Other”\?/,
    );
    await keep(page, "confirm-rename");
    // What is chosen while a case is being sent is the next case.
    const next = { name: "next.nii", mimeType: "application/octet-stream", buffer: Buffer.from(markedVolume()) };
    await page.locator("#upload-volume").setInputFiles(next);
    await page.keyboard.press("Escape");
    await page.waitForFunction(() =>
      /already here as “Marked · added .* · [0-9a-f]{8}”/.test(
        document.querySelector("#upload-done")?.textContent ?? "",
      ),
    );
    assert.equal(await page.locator(".chosen-names").innerText(), "next.nii");
    assert.equal(await page.locator("#upload-name").inputValue(), "", "the next case does not get this one's label");
    assert.equal(await marked.count(), 1, "it has its label still");
    await again("Other");
    await page.locator("dialog.confirm-rename button[value=rename]").click();
    await page.locator("#case-list [data-id]", { hasText: "Other" }).waitFor();
    await again("Marked");
    await page.locator("dialog.confirm-rename button[value=rename]").click();
    await marked.waitFor();
    assert.equal(await page.locator("#case-list [data-id]").count(), 2);
  },
);

test("the list is sorted, walked through with arrows, and its rows are low", { skip }, async () => {
  const titles = (): Promise<string[]> => page.locator("#case-list .title").allInnerTexts();
  assert.deepEqual(await titles(), ["Second", "Marked"]);
  await page.locator("#case-order").selectOption("label");
  await until(titles, ([first]) => first === "Marked");
  await page.locator("#case-list a").first().focus();
  await page.keyboard.press("ArrowDown");
  assert.match(await page.evaluate(() => document.activeElement?.textContent ?? ""), /Second/);
  await page.keyboard.press("ArrowUp");
  assert.match(await page.evaluate(() => document.activeElement?.textContent ?? ""), /Marked/);
  for (const item of await page.locator("#case-list [data-id]").all()) {
    assert.ok(((await item.boundingBox())?.height ?? 99) <= 56, "a row of at most 56 pixels");
    const id = (await item.getAttribute("data-id")) ?? "";
    assert.equal(await item.locator(".id").innerText(), id.slice(0, 8), "rows of one label differ");
    const title = await item.locator(".title").boundingBox();
    assert.ok(title && title.y + title.height <= ((await item.locator(".id").boundingBox())?.y ?? 0) + 1);
  }
  // A row is one stop of the tabulator; its case is put into the trash by a key, and comes back.
  await page.locator("#case-list a").first().focus();
  await page.keyboard.press("Tab");
  const focused = (): Promise<string> =>
    page.evaluate(() => document.activeElement?.closest("#case-list [data-id]")?.textContent ?? "");
  assert.match(await focused(), /Second/);
  await page.keyboard.press("Delete");
  await page.locator(".trashed", { hasText: "Second" }).waitFor();
  await until(titles, (all) => all.length === 1);
  await page.locator(".trashed button").click();
  await until(titles, (all) => all.length === 2);
  assert.equal(await page.locator(".trashed").count(), 0);
  await page.locator("#case-order").selectOption("newest");
});

test(
  "without a case the list is a table, which the server filters and sorts; the address keeps that, and no words",
  { skip },
  async () => {
    const { page: list, troubles, context } = await openPage(browser);
    const asked: Record<string, unknown>[] = [];
    list.on("request", (request) => {
      if (request.url().endsWith("/search")) asked.push(request.postDataJSON() as Record<string, unknown>);
    });
    const titles = (): Promise<string[]> => list.locator("#case-list .title").allInnerTexts();
    const hash = (): string => new URL(list.url()).hash;
    await list.goto(`${origin}/#cases&sort=label&status=new`);
    await until(titles, (all) => all.join() === "Marked,Second");
    assert.equal(await list.locator("#case-status").inputValue(), "new");
    const heads = await list.getByRole("columnheader").allInnerTexts();
    assert.equal(heads.join(), "Case,Series,Day,Mask,Layers,Places,Findings,Reader,State");
    assert.equal(await list.locator(".c-label[aria-sort]").getAttribute("aria-sort"), "ascending");
    const marked = list.locator("#case-list [data-id]", { hasText: "Marked" });
    assert.match(await marked.innerText(), /1 mm|2 mm/);
    assert.match(await marked.locator(".c-mask").innerText(), /Check the mask/);
    assert.equal(await marked.locator(".c-state").innerText(), "New");
    assert.deepEqual(await violations(list), []);
    // A heading sorts, and once more the other way round.
    const byDay = list.getByRole("columnheader", { name: "Day" }).getByRole("button");
    await byDay.click();
    await until(titles, (all) => all.join() === "Second,Marked");
    await byDay.click();
    await until(titles, (all) => all.join() === "Marked,Second");
    assert.equal(hash(), "#cases&status=new&sort=oldest");
    // What somebody has written is begun.
    const id = (await marked.getAttribute("data-id")) ?? "";
    const findings = new URL(`v1/cases/${id}/findings`, server.address);
    const before = await fetch(findings);
    const shownCase = (await (await fetch(new URL(`v1/cases/${id}`, server.address))).json()) as {
      envelope_sphere: { center_in_patient: number[] };
    };
    const finding = {
      id: "one",
      kind: "point",
      points_in_patient: [shownCase.envelope_sphere.center_in_patient],
      depth_mm: 9,
      label: "",
      note: "",
      author: "Ana",
      colour: "#ffb000",
      is_dismissed: false,
    };
    const put = (all: unknown[], tag: string | null): Promise<Response> =>
      fetch(findings, {
        method: "PUT",
        headers: { "if-match": tag ?? "", "content-type": "application/json" },
        body: JSON.stringify({ findings: all }),
      });
    const stored = await put([finding], before.headers.get("etag"));
    assert.equal(stored.status, 200, await stored.clone().text());
    await until(titles, (all) => all.join() === "Second");
    await list.locator("#case-status").selectOption("begun");
    await until(titles, (all) => all.join() === "Marked");
    assert.deepEqual(
      await Promise.all(["findings", "reader", "state"].map((name) => marked.locator(`.c-${name}`).innerText())),
      ["1", "Ana", "Begun"],
    );
    await list.locator("#case-days").selectOption("7");
    await list.locator("#case-search").fill("ana");
    await until(titles, (all) => all.join() === "Marked");
    assert.equal(hash(), "#cases&status=begun&days=7&sort=oldest");
    // By its mask, and by what it has.
    await list.locator("#case-mask").selectOption("ok");
    await list.getByText("No case matches.").waitFor();
    await list.locator("#case-mask").selectOption("review");
    await list.locator("#case-has").selectOption("findings");
    await until(titles, (all) => all.join() === "Marked");
    assert.equal(hash(), "#cases&status=begun&days=7&mask=review&has=findings&sort=oldest");
    assert.deepEqual(await violations(list), []);
    await keep(list, "worklist-filtered");
    for (const name of ["mask", "has"]) await list.locator(`#case-${name}`).selectOption("");
    await until(
      async () => asked.at(-1)?.text,
      (text) => text === "ana",
    );
    assert.ok(asked.every(({ patients }) => patients === false));
    await keep(list, "worklist");
    await list.evaluate(() => (document.documentElement.dataset["theme"] = "light"));
    await keep(list, "worklist-light");
    await list.evaluate(() => (document.documentElement.dataset["theme"] = "dark"));
    // Enter opens a case; Back leads to the list as it was.
    await marked.locator("a").focus();
    await list.keyboard.press("Enter");
    await shown(list);
    await list.goBack();
    await list.waitForSelector(".list-alone");
    assert.equal(hash(), "#cases&status=begun&days=7&sort=oldest");
    assert.equal(await list.locator("#case-search").inputValue(), "ana");
    assert.equal((await put([], stored.headers.get("etag"))).status, 200);
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

async function writtenPhantom(): Promise<string[]> {
  const files = [
    ["head.nii", markedVolume(5)],
    ["mask.nii", brainMask()],
  ] as const;
  return Promise.all(
    files.map(async ([name, bytes]) => {
      const file = path.join(stage.folder, name);
      await writeFile(file, bytes);
      return file;
    }),
  );
}

test("a search leaves the cases that match", { skip }, async () => {
  const titles = (): Promise<string[]> => page.locator("#case-list .title").allInnerTexts();
  await page.locator("#case-search").fill("mark");
  await until(titles, (all) => all.join() === "Marked");
  await page.locator("#case-search").fill("nobody");
  await page.locator("#cases-note", { hasText: "No case matches" }).waitFor();
  await page.locator("#case-search").fill("");
  await until(titles, (all) => all.length === 2);
  await keep(page, "cases");
});

test(
  "over a slow line the first picture comes before the volume, whose bytes are counted",
  { skip, timeout: 600_000 },
  async () => {
    const slow = await openPage(browser, { viewport: { width: 700, height: 600 } });
    const session = await slow.context.newCDPSession(slow.page);
    await session.send("Network.enable");
    // Fast 4G: 9 Mbit/s, 60 ms.
    await session.send("Network.emulateNetworkConditions", {
      offline: false,
      latency: 60,
      downloadThroughput: 9e6 / 8,
      uploadThroughput: 3e6 / 8,
    });
    const id = await readyCase(server.address);
    await slow.page.goto(`${origin}/?renderer=server#${id}`);
    await slow.page.waitForSelector("#surface[data-drawn=true]");
    assert.equal(await slow.page.locator(".viewer[data-loaded=true]").count(), 0, "the volume is still on its way");
    await slow.page.waitForFunction(() => /\d MB/.test(document.querySelector(".loading-line")?.textContent ?? ""));
    await slow.page.locator(".cancel-load").click();
    await slow.page.waitForFunction(() => document.querySelector("#live")?.textContent === "Loading was cancelled.");
    await slow.context.close();
  },
);

test(
  "while the page's own data come, a small picture of the server's is shown",
  { skip, timeout: 600_000 },
  async () => {
    const slow = await openPage(browser, { viewport: { width: 900, height: 700 } });
    const id = await readyCase(server.address);
    const session = await slow.context.newCDPSession(slow.page);
    await session.send("Network.enable");
    await slow.page.goto(`${origin}/#`);
    await slow.page.waitForSelector("#case-list [data-id]");
    // A slow line: 5 Mbit/s, 40 ms.
    await session.send("Network.emulateNetworkConditions", {
      offline: false,
      latency: 40,
      downloadThroughput: 5e6 / 8,
      uploadThroughput: 1e6 / 8,
    });
    const begun = Date.now();
    await slow.page.evaluate((one) => (location.hash = one), id);
    await slow.page.waitForSelector("#surface[data-drawn=true]");
    const first_ms = Date.now() - begun;
    assert.equal(await slow.page.locator(".surface-host[data-preview=true] img").count(), 1);
    const box = await slow.page.locator("#surface").boundingBox();
    await slow.page.mouse.dblclick((box?.x ?? 0) + (box?.width ?? 0) / 2, (box?.y ?? 0) + (box?.height ?? 0) / 2);
    assert.match((await slow.page.textContent("#live")) ?? "", /The point will be marked when it is complete/);
    await keep(slow.page, "first-preview");
    await slow.page.waitForFunction(
      () => document.querySelector<HTMLElement>("canvas.cortex")?.dataset.frames,
      null,
      {},
    );
    console.log(`5 Mbit/s: the server's picture after ${first_ms} ms, the page's own after ${Date.now() - begun} ms`);
    assert.equal(await slow.page.locator(".surface-host img").count(), 0, "the page's own picture is up");
    await slow.page.waitForFunction(() => /&x=/.test(location.hash));
    assert.deepEqual(slow.troubles, []);
    await slow.context.close();
  },
);

test("a server that dies is missed in words, and found again when it is back", { skip, timeout: 600_000 }, async () => {
  const port = Number(new URL(origin).port);
  await server.stop("SIGKILL");
  await typeDepth(page, 6.5);
  await page.waitForSelector("#silence:not([hidden])");
  assert.match(await page.locator("#silence").innerText(), /does not answer/);
  // It is said once, and in words.
  const said = await page.evaluate(() => document.body.innerText.match(/does not answer|unreachable/gi)?.length);
  assert.equal(said, 1);
  server = stage.server = await startServer({ command: "serve", data: stage.data, port });
  await page.waitForSelector("#silence", { state: "hidden" });
  await page.waitForSelector("#surface[data-depth='6.5']");
});

test("the versions of a case are told apart in the list", { skip, timeout: 600_000 }, async () => {
  const first = page.locator("#case-list [data-id]", { hasText: "Marked" });
  const id = await first.getAttribute("data-id");
  const answer = await fetch(new URL(`v1/cases/${id}/mask?offset_mm=1`, server.address), { method: "PUT" });
  const { id: version } = (await answer.json()) as { id: string };
  await page.waitForSelector(`#case-list [data-id="${version}"][data-state=ready]`);
  const words = (one: string | null): Promise<string> => page.locator(`#case-list [data-id="${one}"]`).innerText();
  assert.match(await words(version), /\d:\d\d · offset -?\d/);
  await page.waitForFunction(
    (one) => /\d:\d\d · first version/.test(document.querySelector(`#case-list [data-id="${one}"]`)?.textContent ?? ""),
    id,
  );
  await fetch(new URL(`v1/cases/${version}`, server.address), { method: "DELETE" });
  await page.waitForSelector(`#case-list [data-id="${version}"]`, { state: "detached" });
});

test("a case is renamed from its panel, and everything bears the new label", { skip }, async () => {
  const id = (await page.locator("#case-list [data-id]", { hasText: "Marked" }).getAttribute("data-id")) ?? "";
  const { page: own, troubles, context } = await openPage(browser);
  await own.goto(new URL(`#${id}&d=7`, server.address).href);
  await shown(own);
  await tab(own, "case");
  await own.locator("button", { hasText: "Rename …" }).click();
  await own.locator("dialog.ask-text #text").fill("Renamed");
  await own.keyboard.press("Enter");
  await own.waitForSelector("#case-title:has-text('Renamed')");
  await shown(own);
  assert.match(await own.title(), /^Renamed · /);
  assert.match(await own.locator(".pane.surface").first().innerText(), /Renamed · added /);
  assert.equal(new URL(own.url()).hash, `#${id}&d=7`);
  const back = { method: "PATCH", body: JSON.stringify({ name: "Marked" }) };
  assert.equal((await fetch(new URL(`v1/cases/${id}`, server.address), back)).status, 200);
  assert.deepEqual(troubles, []);
  await context.close();
});

test("a case in the trash comes back, or is deleted after a confirmation", { skip }, async () => {
  const item = page.locator("#case-list [data-id]", { hasText: "Marked" });
  const id = await item.getAttribute("data-id");
  const status = async (): Promise<number> => (await fetch(new URL(`v1/cases/${id}`, server.address))).status;
  await item.locator(".icon-button").click();
  await item.waitFor({ state: "detached" });
  // A link still opens it, and states where it is.
  await page.evaluate((of) => (location.hash = of ?? ""), id);
  await page.locator("#in-trash button").click();
  await page.locator("#in-trash").waitFor({ state: "detached" });
  await item.locator(".icon-button").click();
  await page.locator("#in-trash").waitFor();
  await page.locator("#case-status").selectOption("trash");
  await item.waitFor();
  await item.getByRole("button", { name: /out of the trash/ }).click();
  await item.waitFor({ state: "detached" });
  await page.locator("#case-status").selectOption("");
  await item.locator(".icon-button").click();
  await page.locator("#case-status").selectOption("trash");
  const remove = item.getByRole("button", { name: /^Delete/ });
  await remove.click();
  // Versions have the same label.
  assert.match(await page.locator("dialog.confirm-delete").innerText(), new RegExp(`Marked · .* · ${id?.slice(0, 8)}`));
  assert.deepEqual(await violations(page), []);
  await page.locator("dialog.confirm-delete button[value=keep]").click();
  assert.equal(await status(), 200);
  await remove.click();
  await page.keyboard.press("Escape");
  assert.equal(await status(), 200);
  await remove.click();
  await page.locator("dialog.confirm-delete button[value=delete]").click();
  await item.waitFor({ state: "detached" });
  assert.equal(await status(), 404);
  await page.evaluate((gone) => (location.hash = gone ?? ""), id);
  await page.waitForFunction(() =>
    /does not exist|no case/i.test(document.querySelector("#case-note")?.textContent ?? ""),
  );
});

test("nothing failed but what was made to, and nothing broke the content security policy", { skip }, () => {
  const expected =
    /415|422|400|ERR_CONNECTION_REFUSED|ERR_CONNECTION_RESET|ERR_EMPTY_RESPONSE|404|ERR_INCOMPLETE_CHUNKED/;
  assert.deepEqual(
    watched.troubles.filter((one) => !expected.test(one)),
    [],
  );
});
