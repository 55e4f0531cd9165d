// What a case from DICOM has beside its pictures: the patient, and results that are sent to a node.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { type Server as Node, createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { after, before, test } from "node:test";

import type { Browser } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedSeries, markedVolume } from "./phantom.ts";
import {
  type Server,
  type Stage,
  configured,
  findingsOf,
  keep,
  openPage,
  shown,
  skip,
  startStage,
  tab,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

let stage: Stage | undefined;
let server: Server;
let browser: Browser;
let node: Node;
let id: string;
/** What the node was sent; it is busy at first. */
const sent: Buffer[] = [];
let busy = 1;

before(
  async () => {
    if (skip) return;
    node = createServer((request, response) => {
      const pieces: Buffer[] = [];
      request.on("data", (piece: Buffer) => pieces.push(piece));
      request.on("end", () => {
        if (busy > 0) {
          busy -= 1;
          response.writeHead(503, { "retry-after": "1" }).end();
          return;
        }
        const body = Buffer.concat(pieces);
        sent.push(body);
        // The boundary has the instance UID.
        const uid = /^--isocortex-([\d.]+)/.exec(body.toString("latin1", 0, 100))?.[1];
        const item = { "00081155": { vr: "UI", Value: [uid] } };
        const report = { "00081199": { vr: "SQ", Value: [item] } };
        response.writeHead(200, { "content-type": "application/dicom+json" }).end(JSON.stringify(report));
      });
    });
    await new Promise<void>((resolve) => node.listen(0, "127.0.0.1", resolve));
    const { port } = node.address() as AddressInfo;
    const text = `[page]\npatient_banner = true\n[pacs]\nstable_seconds = 1\n[[pacs.nodes]]\nname = "archive"\nurl = "http://127.0.0.1:${port}/"\n`;
    stage = await startStage("serve", (folder) => configured(folder, text));
    ({ server, browser } = stage);
    id = await sendCase(server, { dicom: markedSeries({ name: "Müller^Änne", id: "P-77" }), mask: brainMask() });
  },
  { timeout: 900_000 },
);

after(async () => {
  await stage?.end();
  await new Promise((resolve) => node?.close(resolve));
});

test("the page shows the patient where it may, nowhere else, and a key hides the patient", { skip }, async () => {
  const watched = await openPage(browser);
  const { page } = watched;
  await page.goto(`${server.address}#${id}`);
  await shown(page);
  const banner = page.locator(".patient-banner");
  await banner.waitFor();
  const text = "Müller, Änne · P-77 · * 1967-03-12 · F · study of 2026-11-01 · series 4 t1 phantom";
  assert.equal(await banner.textContent(), text);
  await keep(page, "pacs-banner");
  assert.deepEqual(await violations(page), []);
  for (const elsewhere of [await page.title(), page.url()]) assert.doesNotMatch(elsewhere, /ller|P-77/);
  await page.keyboard.press("d");
  await banner.waitFor({ state: "hidden" });
  await page.keyboard.press("d");
  await banner.waitFor({ state: "visible" });
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

test("no picture is seen before its patient", { skip }, async () => {
  const watched = await openPage(browser);
  const { page } = watched;
  let answer = (): void => {};
  const isAnswered = new Promise<void>((resolve) => (answer = resolve));
  await page.route(`**/v1/cases/${id}/dicom`, async (route) => {
    await isAnswered;
    await route.continue();
  });
  await page.goto(`${server.address}#${id}`);
  await shown(page);
  const opacity = (): Promise<string> =>
    page
      .locator(".viewer canvas")
      .first()
      .evaluate((canvas) => getComputedStyle(canvas).opacity);
  assert.equal(await page.locator(".patient-banner").count(), 0);
  assert.equal(await opacity(), "0");
  answer();
  await page.locator('.viewer[data-patient="met"]').waitFor();
  assert.equal(await page.locator(".patient-banner").count(), 1);
  assert.equal(await opacity(), "1");
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

test("a result is previewed, sent to a node that is busy at first, and saved", { skip }, async () => {
  const watched = await openPage(browser);
  const { page } = watched;
  await page.goto(`${server.address}#${id}&d=6&v=right`);
  await shown(page);
  await tab(page, "case");
  await page.locator(".pacs summary").click();
  await page.getByRole("button", { name: "Send a result" }).click();
  const dialog = page.locator("dialog.result");
  const previewed = (): Promise<string | null> => dialog.locator(".server-shot").getAttribute("data-shown");
  assert.equal(await until(previewed, (kind) => kind === "view"), "view");
  await keep(page, "pacs-result");
  assert.deepEqual(await violations(page), []);
  await dialog.getByRole("button", { name: "Send", exact: true }).click();
  const said = dialog.locator("#result-said");
  const has = "archive has it.";
  assert.equal(
    await until(
      async () => said.textContent(),
      (words) => words === has,
    ),
    has,
  );
  assert.equal(sent.length, 1);
  for (const inIt of ["DICM", "P-77", "Müller^Änne", "1.2.3.4.30"]) assert.ok(sent[0]?.includes(inIt), inIt);

  await page.selectOption("#result-kind", "sheet");
  assert.equal(await until(previewed, (kind) => kind === "sheet"), "sheet");
  await keep(page, "pacs-sheet");
  // Nothing is marked, so there are no findings to send.
  assert.equal(await page.locator("#result-kind option[value^=finding]").count(), 0);
  await page.selectOption("#result-kind", "envelope");
  await dialog.getByText("no preview").waitFor();
  const saved = page.waitForEvent("download");
  await dialog.getByRole("button", { name: "Save as a file" }).click();
  const file = await saved;
  assert.match(file.suggestedFilename(), /^isocortex-[0-9a-f]{8}-envelope\.dcm$/);
  const bytes = await readFile(await file.path());
  assert.equal(bytes.toString("latin1", 128, 132), "DICM");
  // What was sent is listed.
  await dialog.getByRole("button", { name: "Close" }).click();
  const listed = page.getByRole("list", { name: "Results that were sent" }).getByRole("listitem");
  await listed.getByText(/\d\d:\d\d: archive has it\.$/).waitFor();
  assert.equal(await listed.count(), 1);
  await keep(page, "pacs-sent");
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

test(
  "findings are sent as a report, saved with the patient's name if that is chosen, and read back",
  { skip },
  async () => {
    const watched = await openPage(browser);
    const { page } = watched;
    await page.goto(`${server.address}#${id}&d=6&v=right&x=-38,0,0`);
    await shown(page);
    await page.getByRole("button", { name: "Mark the cross as a finding" }).click();
    await page.locator(".finding-label").fill("thick gyrus");
    await tab(page, "case");
    await page.locator(".pacs summary").click();
    await page.getByRole("button", { name: "Send a result" }).click();
    const dialog = page.locator("dialog.result");
    assert.equal(await dialog.locator("option[value^=finding]").count(), 2);
    await page.selectOption("#result-kind", "findings");
    const before = sent.length;
    await dialog.getByRole("button", { name: "Send", exact: true }).click();
    await dialog.getByText("archive has it.").waitFor();
    assert.equal(sent.length, before + 1);
    assert.ok(sent.at(-1)?.includes("thick gyrus"), "the report has what was typed last");
    await dialog.getByRole("button", { name: "Close" }).click();

    await tab(page, "read");
    const saved = async (name: string): Promise<string> => {
      const download = page.waitForEvent("download");
      await page.getByRole("button", { name }).click();
      return (await download).path();
    };
    assert.doesNotMatch(await readFile(await saved("Save the report"), "utf8"), /Müller/);
    await page.locator("#report-patient").check();
    assert.match(await readFile(await saved("Save the report"), "utf8"), /Müller/);

    await page.getByText("Other files").click();
    await page.locator("#findings-format").selectOption({ label: "DICOM report (SR)" });
    const report = await saved("Save the findings");
    await page.getByRole("button", { name: /^Remove 1/ }).click();
    await page.locator("#findings-file").setInputFiles({ name: "a.dcm", mimeType: "", buffer: await readFile(report) });
    await page.getByText("Added from the file: 1").waitFor();
    await page.locator(".row-button").click();
    assert.equal(await page.locator(".finding-label").inputValue(), "thick gyrus");
    await page.getByRole("button", { name: /^Remove 1/ }).click();
    assert.deepEqual(watched.troubles, []);
    await watched.context.close();
  },
);

test("a case of no patient has neither, and shows all the rest", { skip }, async () => {
  const other = await sendCase(server, { volume: markedVolume(3), mask: brainMask() });
  const watched = await openPage(browser);
  const { page } = watched;
  await page.goto(`${server.address}#${other}`);
  await shown(page);
  assert.equal(await page.locator(".patient-banner, .pacs, #report-patient").count(), 0);
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

test(
  "findings of another case are taken over once both heads are seen, and confirmed one by one",
  { skip },
  async () => {
    const other = await sendCase(server, { volume: markedVolume(3), mask: brainMask() });
    const address = new URL(`v1/cases/${id}/findings`, server.address);
    const known = (await fetch(address)).headers.get("etag") ?? "";
    const points_in_patient = [[-38, 0, 0]];
    const marked = { id: "taken", kind: "point", points_in_patient, depth_mm: 8, label: "thick gyrus" };
    const body = JSON.stringify({ findings: [marked] });
    const put = await fetch(address, { method: "PUT", headers: { "if-match": known }, body });
    assert.equal(put.status, 200);
    const watched = await openPage(browser);
    const { page } = watched;
    await page.goto(`${server.address}#${other}`);
    await shown(page);
    await page.getByText("Other files").click();
    await page.getByRole("button", { name: "Take over from another case" }).click();
    const agree = page.getByRole("button", { name: "Take over", exact: true });
    assert.ok(await agree.isDisabled());
    await page.locator("#take-over-other").selectOption(id);
    await page.getByText("Findings that this case does not have: 1").waitFor();
    const head = (one: string) => page.locator(`.two-heads [data-id="${one}"]`);
    for (const one of [id, other]) await head(one).locator("img").waitFor();
    assert.match(await head(id).innerText(), /Müller, Änne · P-77/);
    assert.match(await head(other).innerText(), /No patient is shown/);
    assert.deepEqual(await violations(page), []);
    await keep(page, "take-over");
    await agree.click();
    await page.getByText("Taken over, not confirmed").waitFor();
    await page.locator(".row-button").click();
    const [taken] = await findingsOf(server, other);
    assert.deepEqual(
      [taken?.label, taken?.points_in_patient, taken?.is_unconfirmed],
      ["thick gyrus", points_in_patient, true],
    );
    await page.getByRole("button", { name: /Confirm the place$/ }).click();
    const stored = () => findingsOf(server, other);
    await until(stored, (list) => list.length === 1 && list[0]?.is_unconfirmed === undefined);
    assert.equal(await page.getByText("Taken over, not confirmed").count(), 0);
    assert.deepEqual(watched.troubles, []);
    await watched.context.close();
  },
);

test("a launch that fits several studies asks which one; its query leaves the address at once", { skip }, async () => {
  const watched = await openPage(browser, { locale: "pt-BR" });
  const { page } = watched;
  const asked: unknown[] = [];
  const candidate = { state: "ready", is_derived: false, has_contrast: false, voxel_mm: [1, 1, 1.25] };
  await page.route("**/v1/launch", (route) => {
    asked.push(route.request().postDataJSON());
    const candidates = [
      { ...candidate, case: id, study_date: "20261101", series: "4 MR" },
      { ...candidate, case: "0".repeat(32), state: "preparing", study_date: "20250630", series: "2 MR" },
    ];
    return route.fulfill({ json: { state: "choice", candidates, ignored: [], nodes: [] } });
  });
  const { origin } = new URL(server.address);
  await page.goto(`${origin}/launch?accessionNumber=A77`);
  const choices = page.locator("#actions button");
  await choices.first().waitFor();
  assert.equal(page.url(), `${origin}/launch`);
  assert.deepEqual(asked, [{ query: "?accessionNumber=A77" }]);
  assert.deepEqual(await choices.allInnerTexts(), [
    `2026-11-01 · série 4 MR · 1 × 1 × 1,25 mm · ${id.slice(0, 8)}`,
    "2025-06-30 · série 2 MR · 1 × 1 × 1,25 mm · em preparação · 00000000",
  ]);
  assert.deepEqual(await violations(page), []);
  await keep(page, "launch");
  // A page that does not load leaves no token behind.
  await page.route(`${origin}/`, (route) => route.fulfill({ status: 502, body: "" }));
  await choices.first().click();
  const said = page.locator("#message");
  await until(
    async () => said.innerText(),
    (words) => words.includes("502"),
  );
  assert.equal(await page.evaluate(() => sessionStorage.length), 0);
  await page.unroute(`${origin}/`);
  await choices.first().click();
  await shown(page);
  assert.ok(page.url().includes(`#${id}`));
  // The browser's own line about the page that did not load.
  const others = watched.troubles.filter((trouble) => !trouble.includes("502 (Bad Gateway)"));
  assert.deepEqual(others, []);
  await watched.context.close();
});

test("a launch that opens one of several heads says so, and leads back to the choice", { skip }, async () => {
  const watched = await openPage(browser);
  const { page } = watched;
  const asked: unknown[] = [];
  const candidate = { state: "ready", is_derived: false, has_contrast: false, voxel_mm: [1, 1, 1.25] };
  await page.route("**/v1/launch", (route) => {
    asked.push(route.request().postDataJSON());
    const candidates = [
      { ...candidate, case: id, study_date: "20261101", series: "4 MR" },
      { ...candidate, case: "0".repeat(32), study_date: "20261101", series: "5 MR" },
    ];
    return route.fulfill({ json: { state: "ready", case: id, candidates, ignored: [], nodes: [] } });
  });
  const { origin } = new URL(server.address);
  await page.goto(`${origin}/launch?study=1.2.3.4`);
  const line = page.locator(".others");
  await line.waitFor();
  assert.match(await line.innerText(), /^This study has one other head\.\s+Choose another head/);
  await keep(page, "launch-others");
  assert.deepEqual(await violations(page), []);
  // The study is in no address, and not left behind.
  assert.ok(page.url().startsWith(`${origin}/#${id}`));
  assert.doesNotMatch(await page.evaluate(() => JSON.stringify({ ...sessionStorage })), /1\.2\.3\.4/);
  await line.getByRole("link").click();
  const choices = page.locator("#actions button");
  await choices.nth(1).waitFor();
  assert.equal(page.url(), `${origin}/launch`);
  assert.deepEqual(asked, [{ query: "?study=1.2.3.4" }, { query: "?study=1.2.3.4" }]);
  await choices.first().click();
  await shown(page);
  // It was chosen: there is nothing to say.
  assert.ok(await line.isHidden());
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

test("what came is listed and filtered, and a refused series is taken as a case", { skip }, async () => {
  const watched = await openPage(browser);
  const { page } = watched;
  const counts = { instances: 176, corrected: 0, ignored: 0, first_at: "2026-11-01T09:00:00Z" };
  const missing = { name: "dicom-slices-missing", detail: "slices 12 and 13 of 178 are missing" };
  const refused = { ...counts, id: "7", state: "nothing", label: "T1 MPRAGE · 2026-11-01", reason: missing };
  const other = { ...counts, corrected: 3 };
  const rejected = { ...other, id: "6", state: "nothing", instances: 0, reason: { name: "rejected", detail: "x" } };
  const became = { ...other, id: "5", state: "case", case: id, label: "<b>T1</b>" };
  const asked: string[] = [];
  const posted: unknown[] = [];
  let reads = 0;
  await page.route(/\/v1\/arrivals/, (route) => {
    const request = route.request();
    const { pathname, search } = new URL(request.url());
    if (request.method() === "POST") {
      posted.push(request.postDataJSON());
      return route.fulfill({ status: 202, json: { ...refused, state: "receiving" } });
    }
    // It is read for a while.
    if (pathname.endsWith("/7"))
      return route.fulfill({
        json:
          (reads += 1) < 2
            ? { ...refused, state: "receiving" }
            : { ...refused, state: "case", case: id, refused: missing },
      });
    asked.push(search);
    const all = [refused, rejected, became];
    return route.fulfill({ json: { arrivals: search.includes("state=case") ? [became] : all } });
  });
  await page.goto(`${server.address}#${id}`);
  await shown(page);
  await page.locator("#arrivals").click();
  const dialog = page.locator("dialog.of-pacs");
  const items = dialog.locator(".arrivals li");
  await items.nth(2).waitFor();
  assert.deepEqual(await violations(page), []);
  await keep(page, "arrivals");
  const [first, second, third] = await items.allInnerTexts();
  assert.match(first ?? "", /T1 MPRAGE · 2026-11-01\s+not used[^]*176 images[^]*Slices of the series are missing/);
  assert.match(second ?? "", /Series without a description[^]*corrected: 3 images[^]*The PACS has rejected/);
  assert.equal(await items.nth(1).locator("button").count(), 0, "there is nothing to take");
  assert.match(third ?? "", /^<b>T1<\/b>\s+became a case/);
  await dialog.locator("#arrival-state").selectOption("case");
  await until(
    () => items.count(),
    (count) => count === 1,
  );
  await dialog.locator("#arrival-state").selectOption("");
  await dialog.locator("#arrival-text").fill("mprage");
  await until(
    async () => asked.at(-1),
    (search) => search === "?text=mprage",
  );
  assert.ok(asked.includes("?state=case") && asked.at(-1) === "?text=mprage", asked.join(" "));
  await items.first().getByRole("button", { name: "Take as a case" }).click();
  await dialog.locator(".arrivals li[data-id='7'][data-state=case]").waitFor();
  assert.deepEqual(posted, [{ as: "case", allow_gaps: true }]);
  assert.match(await items.first().innerText(), /Not used at first: Slices of the series are missing/);
  await page.keyboard.press("Enter");
  await dialog.waitFor({ state: "detached" });
  assert.ok(page.url().includes(id));
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});

/** Sends files by STOW-RS; the status of the answer. */
async function store(files: readonly Buffer[]): Promise<number> {
  const parts = files.flatMap((file) => [
    Buffer.from("--part\r\nContent-Type: application/dicom\r\n\r\n"),
    file,
    Buffer.from("\r\n"),
  ]);
  const stored = await fetch(new URL("dicomweb/studies", server.address), {
    method: "POST",
    headers: { "content-type": 'multipart/related; type="application/dicom"; boundary=part' },
    body: new Uint8Array(Buffer.concat([...parts, Buffer.from("--part--\r\n")])),
  });
  return stored.status;
}

/** Sends files, and waits until the server has read their series. */
async function sendSeries(files: readonly Buffer[]): Promise<void> {
  assert.equal(await store(files), 200);
  const list = new URL("v1/arrivals?state=nothing", server.address);
  await until(
    async () => (await (await fetch(list)).json()) as { arrivals: unknown[] },
    ({ arrivals }) => arrivals.length === 1,
  );
}

test("a series that the server refused is taken from the list, and its case opens", { skip }, async () => {
  const patient = { name: "Prado^Lia", id: "P-78" };
  const series = { description: "t2 phantom", study: "1.2.78" };
  await sendSeries(markedSeries(patient, series));
  const watched = await openPage(browser);
  const { page } = watched;
  await page.goto(`${server.address}#${id}`);
  await shown(page);
  await page.locator("#arrivals").click();
  const item = page.locator(".arrivals li", { hasText: "t2 phantom" });
  assert.match(await item.innerText(), /not used[^]*not T1-weighted/);
  await item.getByRole("button", { name: "Take as a case" }).click();
  const taken = page.locator(".arrivals li[data-state=case]", { hasText: "t2 phantom" });
  await taken.waitFor();
  assert.match(await taken.innerText(), /Not used at first: [^]*not T1-weighted/);
  await taken.getByRole("link").click();
  const banner = page.locator(".patient-banner", { hasText: "Prado, Lia · P-78" });
  await banner.waitFor({ timeout: 300_000 });
  await shown(page);
  assert.ok(!page.url().includes(id), page.url());
  const [notice, badge] = [page.locator("#closed"), page.locator("#case-list [aria-current=true] .closed-badge")];
  assert.ok(!(await notice.isVisible()) && !(await badge.isVisible()));
  // The PACS corrects the patient of the first image: what is read here is closed.
  assert.equal(await store(markedSeries({ ...patient, id: "P-87" }, series).slice(0, 1)), 202);
  // The open page hears of it.
  await notice.waitFor();
  assert.match(await notice.innerText(), /^Closed: the archive has sent other images/);
  assert.equal(await badge.innerText(), "Closed");
  assert.deepEqual(await violations(page), []);
  assert.deepEqual(watched.troubles, []);
  await watched.context.close();
});
