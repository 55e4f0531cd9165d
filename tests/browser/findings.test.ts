// What a reader marks stays on the server, and nobody loses what another one wrote.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import {
  type Server,
  type Stage,
  findingsOf,
  fragment,
  keep,
  openMenu,
  openPage,
  skip,
  startStage,
  typeDepth,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let id: string;

/** Where the bright ball is: on the patient's right, LPS mm. */
const MARK = "-38,0,0";

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

const stored = () => findingsOf(server, id);

/** Opens the case with the cross at the bright ball, and waits for what was marked before. */
async function open(page: Page): Promise<void> {
  await page.goto(new URL(`#${id}&r=mesh&d=12&l=slices&x=${MARK}`, server.address).href);
  await page.waitForSelector(".rows", { state: "attached" });
}

/** The path of the file that a button saves. */
async function saved(page: Page, name: string): Promise<string> {
  const download = page.waitForEvent("download");
  await page.getByRole("button", { name }).click();
  return (await download).path();
}

const add = (page: Page): Promise<void> => page.getByRole("button", { name: "Mark the cross as a finding" }).click();

test("a finding is kept on the server, with its side, and is there again", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await open(page);
  await add(page);
  await until(stored, ([one]) => one !== undefined);
  // Whoever states their name after that has made it as well.
  await page.locator("#reader").fill("Dr. A");
  await page.keyboard.press("Tab");
  await until(stored, ([one]) => one?.author === "Dr. A");
  await page.locator(".finding-label").fill("<b>thick</b>\tgyrus");
  await page.locator(".finding-note").fill("seen on the cut");
  await page.locator(".rows select").selectOption("probable");
  await until(stored, ([one]) => one?.note === "seen on the cut" && one.certainty === "probable");
  const [one] = await stored();
  // The ball has no mirror image, so the plane between the sides is doubted, and every side with it.
  assert.deepEqual([one?.label, one?.side, one?.author], ["<b>thick</b> gyrus", "unknown", "Dr. A"]);
  await page.waitForSelector(".slice .finding-marks[data-words]:not([hidden])");
  await keep(page, "findings");

  await page.reload();
  await page.waitForSelector(".finding-label");
  assert.equal(await page.locator(".finding-label").inputValue(), "<b>thick</b> gyrus");
  assert.match((await page.locator(".row-button").textContent()) ?? "", /^1In doubt/);
  assert.deepEqual(await violations(page), []);
  // On a phone too, while it is written about: nothing is too small for a finger, or covered.
  const phone = await openPage(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  await open(phone.page);
  await phone.page.locator(".finding-label").focus();
  assert.deepEqual(await violations(phone.page), []);
  await phone.context.close();

  // The last sentence is in the report, although the server has not had it before.
  await page.locator(".finding-note").fill("the last sentence");
  const report = await saved(page, "Save the report");
  assert.match(await readFile(report, "utf8"), /&lt;b&gt;thick&lt;\/b&gt; gyrus[^]*the last sentence/);
  await page.getByText("Other files").click();
  await page.locator("#findings-format").selectOption({ label: "JSON" });
  const list = await saved(page, "Save the findings");
  const pdf = await saved(page, "PDF");
  assert.match(await readFile(pdf, "latin1"), /^%PDF-1\.7/);

  // The finding and the cut as STL in one patient space: the ball lies where the finding was marked.
  await openMenu(page, "export");
  const ball = await readFile(await saved(page, "Findings as STL"));
  assert.match(ball.toString("latin1", 0, 80), /SPACE=LPS;UNIT=mm;RADIUS=1\.500/);
  const corners = Array.from({ length: ball.readUInt32LE(80) }, (_, facet) =>
    [12, 16, 20].map((at) => ball.readFloatLE(84 + 50 * facet + at)),
  );
  const [place = []] = one?.points_in_patient ?? [];
  for (const corner of corners)
    assert.ok(Math.abs(Math.hypot(...corner.map((part, axis) => part - (place[axis] ?? NaN))) - 1.5) < 0.01);
  const cut = page.waitForEvent("download");
  await page.getByRole("button", { name: "Cut as STL" }).click();
  assert.match((await cut).suggestedFilename(), /^isocortex-[0-9a-f]{8}-whole-[\d.]+mm\.stl$/);
  const surface = await readFile(await (await cut).path());
  assert.match(surface.toString("latin1", 0, 80), /SPACE=LPS;UNIT=mm;DEPTH=/);
  assert.equal(surface.length, 84 + 50 * surface.readUInt32LE(80));
  await keep(page, "export");
  await page.keyboard.press("Escape");

  await page.getByRole("button", { name: /^Remove 1/ }).click();
  await until(stored, (now) => now.length === 0);
  await page.getByRole("button", { name: "Undo", exact: true }).click();
  await until(stored, (now) => now.length === 1);
  // What is in the list is not added again; what is not, is.
  await page.locator("#findings-file").setInputFiles(list);
  await page.getByText("Added from the file: 0").waitFor();
  await page.getByRole("button", { name: /^Remove 1/ }).click();
  await page.locator("#findings-file").setInputFiles(list);
  await page.getByText("Added from the file: 1").waitFor();
  assert.deepEqual(
    (await stored()).map(({ note, author }) => [note, author]),
    [["the last sentence", "Dr. A"]],
  );
  assert.deepEqual(troubles, []);
  await context.close();
});

test("two readers of a case lose nothing", { skip }, async () => {
  const [first, second] = [await openPage(browser), await openPage(browser)];
  for (const { page } of [first, second]) await open(page);
  const before = (await stored()).length;
  // The second page does not know what the first one writes meanwhile.
  await add(first.page);
  await until(stored, (list) => list.length === before + 1);
  await add(second.page);
  await until(stored, (list) => list.length === before + 2);
  await second.page.waitForSelector(`.rows li:nth-child(${before + 2})`);
  for (const { context } of [first, second]) await context.close();
});

test(
  "what the server has not got is there again when the case is opened again, and goes to the server",
  { skip },
  async () => {
    const { page, context } = await openPage(browser);
    await open(page);
    const before = (await stored()).length;
    await page.waitForSelector(`.rows li:nth-child(${before})`);
    const puts = (url: URL): boolean => url.pathname.endsWith("/findings");
    await page.route(puts, (route) =>
      route.request().method() === "PUT" ? route.fulfill({ status: 503, body: "" }) : route.fallback(),
    );
    await add(page);
    await page.locator(".finding-label").last().fill("not sent yet");
    await page.getByText("Not stored yet").waitFor();
    const address = await page.evaluate(() => location.hash);
    await page.evaluate((other) => (location.hash = other), "0".repeat(32));
    await page.locator(".rows").waitFor({ state: "detached" });
    await page.unroute(puts);
    await page.evaluate((back) => (location.hash = back), address);
    await page.waitForSelector(".finding-label");
    assert.equal(await page.locator(".finding-label").last().inputValue(), "not sent yet");
    const list = await until(stored, (now) => now.length === before + 1);
    assert.equal(list.at(-1)?.label, "not sent yet");
    await context.close();
  },
);

test("what is typed goes on from field to field, and is kept as it is typed", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser);
  page.on("dialog", (dialog) => void dialog.accept().catch(() => {}));
  await open(page);
  const before = (await stored()).length;
  await page.waitForSelector(`.rows li:nth-child(${before})`);
  // What is hidden in the panel is scrolled with it, and makes the page no longer.
  assert.equal(await page.evaluate(() => document.documentElement.scrollHeight - innerHeight), 0);
  await add(page);
  // The new one is written about at once, by the keyboard alone: no letter may go to the shortcuts.
  await page.keyboard.type("left gyrus ");
  await page.keyboard.press("Tab");
  await page.keyboard.press("Tab");
  const note = page.locator(".finding-note").last();
  assert.ok(await note.evaluate((field) => field === document.activeElement));
  await page.keyboard.type("r, x and 1 to 6");
  assert.equal(await page.locator(".finding-label").last().inputValue(), "left gyrus");
  assert.equal(await note.inputValue(), "r, x and 1 to 6");
  // It is sent while the field has the focus.
  await until(stored, (list) => list.at(-1)?.note === "r, x and 1 to 6");
  assert.ok(await note.evaluate((field) => field === document.activeElement));
  // A click straight after typing is a click.
  await page.keyboard.type(".");
  const drawn = page.locator(".rows li").last().getByLabel("Shown");
  await drawn.click();
  assert.equal(await drawn.isChecked(), false);
  // All that was typed into one field is one step.
  await page.getByRole("button", { name: "Undo", exact: true }).click();
  assert.deepEqual(
    [await note.inputValue(), await page.locator(".finding-label").last().inputValue()],
    ["", "left gyrus"],
  );
  await page.getByRole("button", { name: "Redo", exact: true }).click();
  assert.equal(await note.inputValue(), "r, x and 1 to 6.");

  // Nothing waits until the field is left.
  await note.click();
  await page.keyboard.press("ControlOrMeta+End");
  await page.keyboard.type(" The last sentence");
  await page.reload();
  const list = await until(stored, (now) => now.at(-1)?.note.endsWith("sentence") === true);
  assert.equal(list.length, before + 1);
  await page.waitForSelector(`.rows li:nth-child(${before + 1})`);
  assert.equal(await note.inputValue(), "r, x and 1 to 6. The last sentence");
  assert.deepEqual(troubles, []);
  await context.close();
});

test("two readers who write about the same finding are told, and both go on in their own", { skip }, async () => {
  const [first, second] = [await openPage(browser), await openPage(browser)];
  await open(first.page);
  await add(first.page);
  const { length: before } = await until(stored, (list) => list.length > 0 && list.at(-1)?.note === "");
  await open(second.page);
  await second.page.waitForSelector(`.rows li:nth-child(${before})`);
  await first.page.locator(".finding-note").last().fill("of the first");
  await until(stored, (list) => list.at(-1)?.note === "of the first");
  await second.page.locator(".finding-note").last().click();
  await second.page.keyboard.type("of the second");
  await until(stored, (list) => list.length === before + 1);
  await second.page.getByText("somebody else, has changed the same findings").waitFor();
  await second.page.keyboard.type(" reader");
  const list = await until(stored, (now) => now.some(({ note }) => note === "of the second reader"));
  assert.ok(list.some(({ note }) => note === "of the first"));
  assert.ok(await second.page.getByText("somebody else, has changed the same findings").isVisible());
  for (const { context } of [first, second]) await context.close();
});

test(
  "marks leave free what is judged: a number on a hair line, and nothing at all while b is held",
  { skip },
  async () => {
    const { page, context, troubles } = await openPage(browser);
    await open(page);
    await page.waitForSelector(".rows li");
    // The outline of the cut lies beside the mark.
    await typeDepth(page, 4);
    await page.waitForSelector(".slice.axial[data-depth='4']");
    const marks = page.locator(".slice.axial .finding-marks");
    const cross = page.locator(".slice.axial .cursor.mark");
    await cross.waitFor();
    const [box, frame] = [await cross.boundingBox(), await page.locator(".slice.axial .slice-view").boundingBox()];
    assert.ok(box && frame);
    // What is in the middle is the head's own: 5 mm to each side, and 6 pixels at least.
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    const clip = { x: x - 2, y: y - 2, width: 4, height: 4 };
    const free = await page.screenshot({ clip });
    await page.locator("#surface").focus();
    await page.keyboard.down("b");
    await cross.waitFor({ state: "hidden" });
    assert.equal(await marks.isVisible(), false);
    assert.deepEqual(await page.screenshot({ clip }), free);
    await page.keyboard.up("b");
    await cross.waitFor();
    // The ring is under the pointer alone.
    assert.equal(await marks.getAttribute("data-ring"), "");
    await page.mouse.move(x, y);
    await page.waitForSelector(".slice.axial .finding-marks[data-ring='1']");
    await page.mouse.move(frame.x + 5, frame.y + 5);
    await page.waitForSelector(".slice.axial .finding-marks[data-ring='']");
    // A close-up has no outline unless it is asked for.
    await page.locator("#surface").focus();
    await page.keyboard.press("z");
    const gold = (): Promise<number> =>
      page.locator(".closer .slice.here canvas, .closer .slice.here img").evaluateAll((all) => {
        const isGold = (data: Uint8ClampedArray): number => {
          let count = 0;
          for (let at = 0; at < data.length; at += 4)
            if ((data[at] ?? 0) > 150 && (data[at] ?? 0) - (data[at + 2] ?? 0) > 90) count += 1;
          return count;
        };
        return all.reduce((sum, one) => {
          if (one.closest(".slice-image") === null) return sum;
          const { clientWidth: width, clientHeight: height } = one;
          const context = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
          context?.drawImage(one as HTMLCanvasElement | HTMLImageElement, 0, 0, width, height);
          return sum + (context ? isGold(context.getImageData(0, 0, width, height).data) : 0);
        }, 0);
      });
    await page.waitForSelector(".closer .slice.sagittal.here:not(.blank)");
    assert.equal(await gold(), 0);
    await page.locator(".closer .slice.axial.here").focus();
    await page.keyboard.press("o");
    assert.ok((await until(gold, (count) => count > 50)) > 50);
    await keep(page, "closer-outlined");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test(
  "whoever may only look is offered nothing that writes, and sees at once what another reader writes",
  { skip },
  async () => {
    const [own, other] = await Promise.all([openPage(browser), openPage(browser)]);
    await own.page.route("**/v1/session", (route) => route.fulfill({ json: { name: "token", scopes: ["read"] } }));
    for (const { page } of [own, other]) await open(page);
    await own.page.getByText("Your access permits looking, not writing.").waitFor();
    assert.ok(await own.page.getByRole("button", { name: "Mark the cross as a finding" }).isDisabled());
    assert.equal(await own.page.locator("#add, #case-list .icon-button").count(), 0);
    await add(other.page);
    await other.page.locator(".finding-label").last().fill("seen by both");
    // Of a row that is not unfolded there are the name and the label alone.
    const row = own.page.locator(".rows li", { hasText: "seen by both" });
    await row.waitFor();
    assert.equal(await row.locator("button, input, select, textarea").count(), 1);
    await row.locator(".row-button").click();
    await own.page.waitForSelector(".finding-label:disabled");
    assert.equal(await own.page.locator(".finding-label").inputValue(), "seen by both");
    for (const { troubles, context } of [own, other]) {
      assert.deepEqual(troubles, []);
      await context.close();
    }
  },
);

test("a link to a finding leads to its place; one of a finding that is gone says so", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser);
  await open(page);
  const known = (await stored()).map((one) => one.id);
  await add(page);
  const after = await until(stored, (now) => now.length > known.length);
  const made = after.find((one) => !known.includes(one.id));
  assert.ok(made);
  await page.evaluate(() => {
    navigator.clipboard.writeText = async (text) => void (document.body.dataset["copied"] = text);
  });
  await page.getByRole("button", { name: "Copy a link to the finding" }).click();
  const link = await until(
    () => page.evaluate(() => document.body.dataset["copied"] ?? ""),
    (text) => text !== "",
  );
  assert.ok(link.endsWith(`#${id}&finding=${made.id}`), link);

  const other = await openPage(browser);
  await other.page.goto(link);
  await other.page.locator(`.rows > li[data-id="${made.id}"][aria-current=true]`).waitFor();
  const { x } = await until(
    () => fragment(other.page),
    (now) => now.x !== undefined,
  );
  assert.equal(x, MARK);
  // Another one by hand, on the page that is open.
  await other.page.goto(new URL(`#${id}&finding=gone`, server.address).href);
  await other.page.getByText("The finding that the address names is not here (any more).").waitFor();
  for (const one of [page, other.page]) assert.deepEqual(await violations(one), []);
  await page
    .getByRole("button", { name: /^Remove / })
    .first()
    .click();
  assert.deepEqual([troubles, other.troubles], [[], []]);
  await other.context.close();
  await context.close();
});
