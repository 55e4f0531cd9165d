// The viewer on a real head: hands, panes, letters, address, words. The server draws the surface here, for what draws
// it is another test's matter and WebGL2 in software is slow.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import type { Page } from "playwright-core";

import { violations } from "./axe.ts";
import { type Demo, type Hands, startDemo } from "./hands.ts";
import {
  type Watched,
  fragment,
  inSettings,
  keep,
  openMenu,
  shown,
  skip,
  speak,
  tab,
  typeDepth,
  until,
} from "./support.ts";

let demo: Demo | undefined;
let watched: Watched;
let page: Page;
let id: string;
let origin: string;
let { text, reset, surface, letters } = {} as Hands;

before(
  async () => {
    if (skip) return;
    demo = await startDemo();
    ({ watched, page, id, origin } = demo);
    ({ text, reset, surface, letters } = demo.hands);
  },
  { timeout: 600_000 },
);

after(() => demo?.end());

const depth = async (): Promise<number> => Number(await page.locator("#depth-number").inputValue());

/** A drag by the mouse from the middle of the surface. */
async function drag(right: number, down: number, button: "left" | "right" | "middle" = "left"): Promise<void> {
  const { x, y, width, height } = await surface();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.down({ button });
  await page.mouse.move(x + width / 2 + right, y + height / 2 + down, { steps: 4 });
  await page.mouse.up({ button });
}

test("the only case is shown at once, and named in the picture, in the tab and in the list", { skip }, async () => {
  assert.equal(await page.locator("#case-list [aria-current=true]").count(), 1);
  const name = await text("#surface .overlay:not(.other) .pane-case");
  assert.match(name, /· added \d+ \w+ \d+ · [0-9a-f]{8}$|· added \w+ \d+, \d+ · [0-9a-f]{8}$/);
  assert.ok(name.endsWith(id.slice(0, 8)), name);
  assert.equal(await page.title(), `${name} · Isocortex`);
  assert.ok(page.url().includes(id), "the address names it from then on");
  await keep(page, "desktop-surface");
});

test("a left drag turns, and a second one over the top finds no pole", { skip }, async () => {
  await reset();
  await drag(120, 0);
  const turned = await fragment(page);
  assert.match(turned.q ?? "", /,/);
  assert.match(await letters("#surface"), /^\w+ \w+ S I$/);
  for (let time = 0; time < 4; time += 1) await drag(0, 300);
  assert.notEqual((await fragment(page)).q, turned.q);
});

test("the wheel zooms, with alt it peels by half a millimetre, with shift as well by a tenth", { skip }, async () => {
  await reset();
  const { x, y, width, height } = await surface();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.wheel(0, -200);
  const zoomed = await until(
    () => fragment(page),
    ({ z }) => z !== undefined,
  );
  assert.ok(Number(zoomed.z) > 1.2);
  const before = await depth();
  await page.keyboard.down("Alt");
  await page.mouse.wheel(0, 120);
  assert.equal(await until(depth, (now) => now !== before), before + 0.5);
  await page.keyboard.down("Shift");
  await page.mouse.wheel(0, 120);
  await until(depth, (now) => now !== before + 0.5);
  await page.keyboard.up("Shift");
  await page.keyboard.up("Alt");
  assert.ok(Math.abs((await depth()) - before - 0.6) < 1e-6);
});

test("shift or the middle button moves, the right button changes the window", { skip }, async () => {
  await reset();
  await page.keyboard.down("Shift");
  await drag(60, 0);
  await page.keyboard.up("Shift");
  const [moved = 0] = (await fragment(page)).p?.split(",").map(Number) ?? [];
  assert.ok(moved > 5);
  await drag(-60, 0, "middle");
  assert.ok(Math.abs(Number((await fragment(page)).p?.split(",")[0] ?? 0)) < 0.2);
  await drag(100, 0, "right");
  const [level = NaN, wider = NaN] = (await fragment(page)).w?.split(",").map(Number) ?? [];
  const { window } = await page.evaluate(
    async (one) => (await (await fetch(`v1/cases/${one}`)).json()).intensity as { window: { width: number } },
    id,
  );
  assert.ok(wider > window.width, "to the right is wider");
  await drag(0, 100, "right");
  const [darker = NaN, width] = (await fragment(page)).w?.split(",").map(Number) ?? [];
  assert.equal(width, wider);
  assert.ok(darker < level, "downwards is a lower level, which is brighter");
  // The direction is a setting.
  await inSettings(page, () => page.locator("#drag").selectOption("up-brighter"));
  await drag(0, 100, "right");
  const [back = NaN] = (await fragment(page)).w?.split(",").map(Number) ?? [];
  assert.ok(back > darker, `${back} after ${darker}`);
  await inSettings(page, () => page.locator("#drag").selectOption("up-darker"));
});

test("every key of the help does what it says", { skip, timeout: 600_000 }, async () => {
  await reset();
  await page.locator("#surface").focus();
  const press = async (key: string): Promise<Record<string, string>> => {
    await page.keyboard.press(key);
    return fragment(page);
  };
  const start = await depth();
  await press("]");
  await press("]");
  await press("[");
  assert.equal(await depth(), start + 0.5);
  for (const [key, view] of [
    ["A", "anterior"],
    ["P", "posterior"],
    ["R", "right"],
    ["S", "superior"],
    ["I", "inferior"],
  ]) {
    assert.equal((await press(`Shift+${key}`)).v, view);
  }
  assert.equal((await press("Shift+L")).v, undefined, "left is the view at first");
  assert.ok((await press("ArrowRight")).q);
  assert.ok((await press("Shift+ArrowRight")).p);
  assert.ok(Number((await press("+")).z) > 1);
  const windows = new Set<string | undefined>();
  for (const key of ["1", "2", "3", "4", "5", "6"]) windows.add((await press(key)).w);
  assert.equal(windows.size, 6);
  assert.equal((await press("i")).m, "inverted");
  assert.equal((await press("i")).m, undefined);
  await press("h");
  assert.equal(await page.locator("dialog.help").count(), 1);
  await page.keyboard.press("Escape");
  await press("Enter");
  assert.ok((await fragment(page)).x, "the middle is marked");
  await page.keyboard.press(" ");
  const playing = await depth();
  await page.waitForFunction(
    (from) => Number(document.querySelector<HTMLInputElement>("#depth-number")?.value) > from + 1,
    playing,
  );
  await page.keyboard.press(" ");
  assert.equal(await page.locator(".play").getAttribute("aria-label"), "Sweep through the depths");
  const paused = await depth();
  await page.waitForTimeout(400);
  assert.equal(await depth(), paused);
  const { d, x, p, z, w } = await press("r");
  assert.deepEqual([d, x, p, z, w], [undefined, undefined, undefined, undefined, undefined]);
});

test("single letters can be switched off", { skip }, async () => {
  await reset();
  await inSettings(page, () => page.locator("#shortcuts").uncheck());
  await page.locator("#stage").focus();
  await page.keyboard.press("Shift+S");
  assert.equal((await fragment(page)).v, undefined);
  await inSettings(page, () => page.locator("#shortcuts").check());
});

test("everything that a drag does a key or a button does as well", { skip }, async () => {
  await reset();
  const click = (name: string): Promise<void> => page.getByRole("button", { name, exact: true }).click();
  await page.locator("#surface").press("ArrowLeft");
  assert.ok((await fragment(page)).q);
  await page.locator("#surface").press("Shift+ArrowUp");
  assert.ok((await fragment(page)).p);
  await click("Deeper");
  await click("Deeper");
  await click("Shallower");
  assert.equal(await depth(), 10.5);
  await click("Superior");
  assert.equal((await fragment(page)).v, "superior");
  await openMenu(page, "window");
  await click("Grey–white");
  assert.ok((await fragment(page)).w);
  await page.locator("#zoom").fill("1");
  assert.equal((await fragment(page)).z, "2");
  await typeDepth(page, 12);
  assert.equal(await depth(), 12);
});

test("two fingers zoom and move; a touch that is taken away ends the gesture", { skip }, async () => {
  await reset();
  const { x, y, width, height } = await surface();
  const [cx, cy] = [x + width / 2, y + height / 2];
  const session = await watched.context.newCDPSession(page);
  const touch = (
    type: "touchStart" | "touchMove" | "touchEnd" | "touchCancel",
    ...points: [number, number][]
  ): Promise<unknown> =>
    session.send("Input.dispatchTouchEvent", {
      type,
      touchPoints: points.map(([px, py], index) => ({ x: px, y: py, id: index })),
    });
  await touch("touchStart", [cx, cy]);
  await touch("touchMove", [cx + 80, cy]);
  await touch("touchEnd");
  const turned = await fragment(page);
  assert.ok(turned.q, "one finger turns");
  await touch("touchStart", [cx - 50, cy], [cx + 50, cy]);
  await touch("touchMove", [cx - 100, cy + 30], [cx + 100, cy + 30]);
  await touch("touchEnd");
  const pinched = await fragment(page);
  assert.equal(pinched.q, turned.q, "two fingers do not turn");
  assert.ok(Math.abs(Number(pinched.z) - 2) < 0.05, pinched.z);
  await touch("touchStart", [cx, cy]);
  await touch("touchCancel");
  await page.mouse.move(cx + 200, cy + 100);
  assert.equal((await fragment(page)).q, turned.q, "nothing is held any more");
});

test(
  "the mirror shows the other hemisphere flipped; the marked one becomes the one that is not",
  { skip },
  async () => {
    await reset();
    await page.locator(".layouts button[value=mirror]").click();
    await page.waitForSelector("#surface.halved");
    const halves = page.locator("#surface > .overlay");
    assert.deepEqual(await halves.nth(0).locator(".edge").allInnerTexts(), ["A", "P", "S", "I"]);
    assert.deepEqual(
      await halves.nth(1).locator(".edge").allInnerTexts(),
      ["A", "P", "S", "I"],
      "the right side, flipped",
    );
    const badges = (): Promise<string[]> => page.locator("#surface .badge").allInnerTexts();
    assert.deepEqual(await badges(), ["Left", "Right (flipped)"]);
    const { x, y, width, height } = await surface();
    const cursor = (half: number): Promise<(string | null)[]> =>
      halves
        .nth(half)
        .locator(".cursor:not([hidden])")
        .evaluateAll((all) =>
          // Between its ticks: the first is to its left, the third above it.
          all.map((one) => `${one.children[2]?.getAttribute("x1")} ${one.children[0]?.getAttribute("y1")}`),
        );
    await page.mouse.move(x + width * 0.2, y + height * 0.5);
    assert.equal((await cursor(0)).length, 1, "the pointer's ghost");
    assert.deepEqual(await cursor(0), await cursor(1));
    // A point of the right half is a point of the right hemisphere.
    await page.mouse.dblclick(x + width * 0.72, y + height * 0.45);
    const { x: marked = "" } = await fragment(page);
    assert.ok(Number(marked.split(",")[0]) < -15, marked);
    await page.waitForFunction(() => document.querySelector("#surface .badge")?.textContent === "Right");
    assert.deepEqual(await badges(), ["Right", "Left (flipped)"]);
    assert.equal((await cursor(0)).length, 1);
    assert.deepEqual(await cursor(0), await cursor(1));
    // Seen from its own side, it is as far from the other edge.
    const [cx] = ((await cursor(0))[0] ?? "").split(" ").map(Number);
    assert.ok(Math.abs((cx ?? 0) - 0.28 * width) < 3, `${cx} of ${width}`);
    const words = (): Promise<string[]> => page.locator("#surface .cursor-words:visible").allInnerTexts();
    assert.deepEqual(await words(), ["marked", "opposite"]);
    // Oblique, and from above, each half still says what it shows.
    await page.keyboard.press("Shift+ArrowUp");
    await page.getByRole("button", { name: "Superior", exact: true }).click();
    await page.waitForFunction(() => document.querySelector("#surface .badge")?.textContent === "Left and right");
    assert.deepEqual(await badges(), ["Left and right", "Left and right (flipped)"]);
    await page.getByRole("button", { name: "Left", exact: true }).click();
    await page.waitForFunction(() => document.querySelector("#surface .badge")?.textContent === "Left");
    assert.deepEqual(await words(), ["opposite", "marked"]);
    await keep(page, "desktop-mirror");
  },
);

test("a marked point is broken where the head is before it", { skip }, async () => {
  await reset();
  const { x, y, width, height } = await surface();
  await page.mouse.dblclick(x + width / 2, y + height / 2);
  await page.waitForSelector("#surface > .overlay:not(.other) .cursor.mark");
  await page.getByRole("button", { name: "Right", exact: true }).click();
  await page.waitForSelector("#surface > .overlay:not(.other) .cursor.hidden");
  await page.getByRole("button", { name: "Left", exact: true }).click();
  await page.waitForSelector("#surface > .overlay:not(.other) .cursor.mark");
  await page.locator(".layouts button[value=mirror]").click();
  await page.waitForSelector("#surface > .overlay:not(.other) .cursor.mark");
  await page.waitForSelector("#surface > .overlay.other .cursor.ghost");
  assert.ok(
    (await page.locator("#surface .cube").isVisible()) &&
      (await page.locator("#surface .colour-bar:not(.map-bar)").isVisible()),
  );
});

test("a number that is out of range, or none, gives way to what is drawn", { skip }, async () => {
  await reset();
  await page.locator("#depth").press("End");
  const deepest = await page.locator("#depth-number").inputValue();
  for (const [typed, expected] of [
    ["999", deepest],
    ["", deepest],
    ["-5", "0"],
    ["7.5", "7.5"],
    ["8,25", "8.25"],
  ] as const) {
    await page.locator("#depth-number").fill(typed);
    await page.keyboard.press("Enter");
    assert.equal(await page.locator("#depth-number").inputValue(), expected, typed);
  }
  const width = await page.locator("#window-width-number").inputValue();
  await openMenu(page, "window");
  await page.locator("#window-width-number").fill("0");
  await page.keyboard.press("Enter");
  assert.equal(await page.locator("#window-width-number").inputValue(), width);
});

test("nothing on the picture lies over an orientation letter, however low the pane is", { skip }, async () => {
  await reset();
  for (const [width, height] of [
    [1024, 600],
    [1024, 768],
    [1440, 600],
  ] as const) {
    await page.setViewportSize({ width, height });
    const letter = await page.locator("#surface > .overlay:not(.other) .edge.right").boundingBox();
    for (const other of [".colour-bar:not(.map-bar)", ".cube"]) {
      const box = await page.locator(`#surface ${other}`).boundingBox();
      assert.ok(letter && box);
      const apart =
        box.x + box.width <= letter.x ||
        letter.x + letter.width <= box.x ||
        box.y + box.height <= letter.y ||
        letter.y + letter.height <= box.y;
      assert.ok(apart, `${other} at ${width} × ${height}`);
    }
  }
  await page.setViewportSize({ width: 1440, height: 900 });
});

test("letters, cube, colour bar, scale, depth and notice are those of the picture", { skip }, async () => {
  await reset();
  const expected = {
    Left: "A P S I",
    Right: "P A S I",
    Anterior: "R L S I",
    Posterior: "L R S I",
    Superior: "L R A P",
    Inferior: "R L A P",
  };
  for (const [name, edges] of Object.entries(expected)) {
    await page.getByRole("button", { name, exact: true }).click();
    await page.waitForFunction(
      (title) => document.querySelector("#surface .pane-title")?.textContent?.includes(title),
      name,
    );
    assert.equal(await letters("#surface"), edges, name);
    const front = page.locator(`#surface .cube [data-view=${name.toLowerCase()}]`);
    assert.equal(await front.getAttribute("opacity"), "1.00");
  }
  await page.locator("#surface .cube [data-view=inferior]").click();
  const { level, width } = await page.evaluate(() => ({
    level: Number(document.querySelector<HTMLInputElement>("#window-center-number")?.value),
    width: Number(document.querySelector<HTMLInputElement>("#window-width-number")?.value),
  }));
  const [white = NaN, black = NaN] = (
    await page.locator(".colour-bar:not(.map-bar) span:not(.layer-title)").allInnerTexts()
  ).map(Number);
  // DICOM's linear window: its ramp is `width − 1` long, and its middle half below the level.
  const expected_white = level - 0.5 + (width - 1) / 2;
  assert.ok(
    Math.abs(white - expected_white) < 0.51 && Math.abs(white - black - (width - 1)) < 0.51,
    `${black} to ${white}`,
  );
  const bar = await page.locator("#surface .overlay:not(.other) .scale-line").boundingBox();
  const pane = await surface();
  const sphere = await page.evaluate(
    async (one) => (await (await fetch(`v1/cases/${one}`)).json()).envelope_sphere.radius_mm as number,
    id,
  );
  const mm = parseFloat(await text("#surface .overlay:not(.other) .scale-text"));
  assert.ok(
    Math.abs((bar?.width ?? 0) - (mm * Math.min(pane.width, pane.height)) / (2 * sphere)) < 1.5,
    "the scale bar is as long as it says",
  );
  assert.match(await text("#surface .overlay:not(.other) .pane-title"), /^10\.0 mm/);
  // It stands on the picture, not in the bar as well.
  assert.equal(await text("#surface .overlay:not(.other) .pane-notice"), "For research use only. Not for diagnosis.");
  assert.equal(await page.locator(".research").isVisible(), false);
});

test("the address holds the state: a reload restores it, Back goes back, nonsense is named", { skip }, async () => {
  await reset();
  await page.goto(`${origin}#${id}&d=11.2&v=superior&z=1.5&l=slices&c=n`);
  await page.reload();
  await page.waitForSelector("#surface[data-drawn=true]");
  assert.equal(await depth(), 11.2);
  assert.equal(await letters("#surface"), "L R A P");
  // A pane is blank until its own picture is there.
  await page.waitForSelector(".slice.axial .badge:not([hidden])");
  assert.equal(await text(".slice.axial .badge"), "Neurological");
  await page.getByRole("button", { name: "Right", exact: true }).click();
  await page.locator(".layouts button[value=single]").click();
  assert.equal((await fragment(page)).v, "right");
  await page.goBack();
  await page.waitForSelector("body[data-layout=slices]");
  await page.goBack();
  await page.waitForFunction(() => document.querySelector("#surface .pane-title")?.textContent?.includes("Superior"));
  assert.equal(await depth(), 11.2);
  await page.goto(`${origin}#${id}&d=abc&v=up&q=0,0,0,0&x=999,999,999&%E0%A4%A&z=2`);
  await page.waitForSelector("#surface[data-drawn=true]");
  const remark = await text(".notices .remark span");
  for (const part of ["d=abc", "v=up", "q=0,0,0,0", "x=999,999,999", "%E0%A4%A"])
    assert.ok(remark.includes(part), remark);
  assert.ok(!remark.includes("z=2"), remark);
  assert.equal((await fragment(page)).z, "2", "what can be read is taken");
  await keep(page, "unread-address");
  await page.locator(".notices .remark button").click();
  await page.waitForSelector(".notices .remark", { state: "hidden" });
  for (const nonsense of [`#${id.slice(1)}`, "#%%%", "#<img src=x>", "#&&&", `#x${id}`]) {
    await page.goto(`${origin}${nonsense}`);
    await page.waitForFunction(() => /names no case/.test(document.querySelector("#case-note")?.textContent ?? ""));
    assert.equal(await page.locator("#surface").count(), 0, nonsense);
    assert.equal(await page.locator("#sidebar").isVisible(), true, "the list is there to choose from");
    assert.equal(await page.title(), "Isocortex");
  }
  await keep(page, "unknown-address");
  await page.goto(`${origin}#${"0".repeat(32)}`);
  await page.waitForFunction(() => document.querySelector("#case-note")?.textContent?.includes("Choose a case"));
  await page.goto(`${origin}#${id}`);
  await shown(page);
  watched.troubles.splice(
    0,
    watched.troubles.length,
    ...watched.troubles.filter((one) => !one.includes(`${"0".repeat(32)}`)),
  );
});

test("the screenshot is a PNG of the panes, and the server's picture has an address to copy", { skip }, async () => {
  await reset();
  const waiting = page.waitForEvent("download");
  await openMenu(page, "export");
  await page.getByRole("button", { name: "Save picture" }).click();
  const download = await waiting;
  assert.equal(download.suggestedFilename(), `isocortex-${id.slice(0, 8)}-10.0mm.png`);
  const png = readFileSync(await download.path());
  const box = await page.locator(".panes").boundingBox();
  assert.equal(png.readUInt32BE(16), Math.round(box?.width ?? 0));
  assert.ok(png.length > 50_000, "a picture, not a black pane");
  await openMenu(page, "export");
  await page.getByRole("button", { name: "Picture from the server" }).click();
  await page.waitForSelector("dialog.server-picture img");
  const address = await page.locator("#server-address").inputValue();
  const answer = await fetch(address);
  assert.equal(answer.headers.get("content-type"), "image/png");
  assert.match(address, /depth_mm=10&view=left/);
  await page.locator("dialog.server-picture button[value=close]").click();
});

test("what is shown is read out: depth, side, place and grey", { skip }, async () => {
  await reset();
  await page.waitForFunction(() =>
    /^Depth 10\.0 millimetres, Left\. Centre of the picture: L\s\d.* millimetres, 10\.0 millimetres deep, T1\s\d/.test(
      document.querySelector("#surface-keys")?.textContent ?? "",
    ),
  );
  await typeDepth(page, 14.5);
  await page.waitForFunction(() => document.querySelector("#live")?.textContent?.includes("Depth 14.5 millimetres"));
});

test(
  "Portuguese and the light theme are chosen once and kept, and nothing of the case is stored",
  { skip },
  async () => {
    await speak(page, "pt-BR");
    await page.waitForSelector(".layouts >> text=Espelho");
    const notice = page.locator("#surface .overlay:not(.other) .pane-notice");
    assert.equal(await notice.innerText(), "Somente para pesquisa. Não se destina a diagnóstico.");
    for (const typed of ["14,5", "14.5"]) {
      await page.locator("#depth-number").fill(typed);
      await page.keyboard.press("Enter");
      assert.equal(await page.locator("#depth-number").inputValue(), "14,5", typed);
    }
    await inSettings(page, () => page.locator("#theme").selectOption("light"));
    await page.reload();
    await page.waitForSelector("html[data-theme=light] .layouts >> text=De perto");
    const stored = await page.evaluate(() => JSON.stringify(localStorage));
    assert.ok(!stored.includes(id) && !stored.includes("Demo"), stored);
  },
);

test(
  "axe finds nothing, in each theme and in each language, in every layout and dialog",
  { skip, timeout: 600_000 },
  async () => {
    const check = async (where: string): Promise<void> => assert.deepEqual(await violations(page), [], where);
    for (const [language, theme] of [
      ["pt-BR", "light"],
      ["en", "dark"],
    ] as const) {
      await speak(page, language);
      await shown(page);
      await page.waitForSelector("#surface[data-drawn=true]");
      await inSettings(page, () => page.locator("#theme").selectOption(theme));
      await page.locator("#surface").focus();
      await page.locator(".layouts button[value=slices]").click();
      await page.locator("#add").evaluate((form) => form.setAttribute("open", ""));
      for (const name of ["case", "images", "read"] as const) {
        await tab(page, name);
        for (const group of await page.locator(".panel > details:visible").all())
          if ((await group.getAttribute("open")) === null) await group.locator("summary").first().click();
        await check(`${language} ${theme} ${name}`);
      }
      if (theme === "light") await keep(page, `light-${language}`);
      for (const layout of ["single", "mirror", "both"]) {
        await page.locator(`.layouts button[value=${layout}]`).click();
        await page.waitForSelector(`body[data-layout=${layout}]`);
        await check(`${language} ${theme} ${layout}`);
      }
      for (const [name, opener] of [
        ["help", ".bar .icon-button >> nth=-1"],
        ["settings", "#settings"],
        ["server-picture", "#menu-export button >> nth=2"],
        ["series", "#menu-export button >> nth=3"],
      ] as const) {
        if (opener.startsWith("#menu-export")) await openMenu(page, "export");
        await page.locator(opener).click();
        await page.waitForSelector(`dialog.${name}`);
        await check(`${language} ${theme} ${name}`);
        if (theme === "dark") await keep(page, `${name}-${language}`);
        await page.keyboard.press("Escape");
        await page.waitForSelector("dialog", { state: "detached" });
      }
    }
    // Without a case, and where a token is asked for.
    await page.locator("#add").evaluate((form) => form.removeAttribute("open"));
    await page.goto(`${origin}#${"0".repeat(32)}`);
    await page.waitForFunction(() => document.querySelector("#case-note")?.textContent?.includes("Choose a case"));
    await check("no case");
    await page.route("**/v1/cases/search", (route) =>
      route.fulfill({
        status: 401,
        contentType: "application/problem+json",
        body: '{"type":"urn:isocortex:problem:unauthorized"}',
      }),
    );
    await page.reload();
    await page.waitForSelector("dialog.ask-token");
    await check("token");
    await page.unroute("**/v1/cases/search");
    await page.goto(`${new URL(origin).origin}/docs`);
    await check("manual");
    await page.goto(`${origin}#${id}`);
    await shown(page);
    watched.troubles.splice(0, watched.troubles.length, ...watched.troubles.filter((one) => !/0{32}|401/.test(one)));
  },
);

test("a tablet shows every view without scrolling sideways", { skip }, async () => {
  await page.setViewportSize({ width: 820, height: 1180 });
  await page.reload();
  await shown(page);
  for (const layout of ["single", "slices", "mirror", "both"]) {
    await page.locator(`.layouts button[value=${layout}]`).click();
    await page.waitForSelector(`body[data-layout=${layout}]`);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= 820), layout);
    assert.ok((await surface()).height > 350, layout);
    if (layout === "slices" || layout === "both")
      await page.waitForFunction(() => document.querySelectorAll(".slice-image img").length === 3);
    await keep(page, `tablet-${layout}`);
  }
  await page.setViewportSize({ width: 1440, height: 900 });
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(watched.troubles, []);
});
