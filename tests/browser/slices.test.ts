// The slices: drawn by the server until the page has the whole volume, then by the page; and the hands on them.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import type { ReadyCase } from "../../web/src/model/case.ts";
import { violations } from "./axe.ts";
import { type Demo, type Hands, startDemo } from "./hands.ts";
import { isBrain, nifti } from "./phantom.ts";
import { picturesAgree } from "./pixels.ts";
import {
  type Server,
  type Watched,
  fragment,
  inSettings,
  keep,
  openPage,
  shown,
  skip,
  typeDepth,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

const PLANES = ["axial", "coronal", "sagittal"] as const;

let demo: Demo | undefined;
let server: Server;
let browser: Browser;
let watched: Watched;
let page: Page;
let id: string;
let { text, reset, surface, letters } = {} as Hands;

before(
  async () => {
    if (skip) return;
    demo = await startDemo();
    ({ server, browser, watched, page, id } = demo);
    ({ text, reset, surface, letters } = demo.hands);
  },
  { timeout: 600_000 },
);

after(() => demo?.end());

test("a double click marks a point: slices, numbers and the depth profile follow", { skip }, async () => {
  await reset();
  await page.locator(".layouts button[value=slices]").click();
  const { x, y, width, height } = await surface();
  await page.mouse.dblclick(x + width * 0.45, y + height * 0.45);
  const { x: marked = "" } = await fragment(page);
  const [left = 0] = marked.split(",").map(Number);
  assert.ok(left > 20, "the left view shows the left side: LPS counts to the left");
  assert.match(await text(".point .position"), /^L\s\d+\.\d · [AP]\s\d+\.\d · [SI]\s\d+\.\d$/);
  assert.equal(await text(".point .depth"), "10.0 mm");
  assert.match(await text(".point .intensity"), /^T1\s\d/);
  await page.waitForFunction(
    (position) =>
      Math.abs(Number(document.querySelector<HTMLElement>(".slice.sagittal")?.dataset.position) - position) < 0.2,
    left,
  );
  // The cross comes with the picture of its position.
  for (const plane of PLANES) {
    const ticks = page.locator(`.slice.${plane} .cursor line`);
    const count = await until(
      () => ticks.count(),
      (found) => found > 0,
    );
    assert.equal(count, 4, plane);
  }
  // Both curves, and the same as a table.
  for (const curve of ["own", "other"]) {
    const path = (await page.locator(`.chart .curve.${curve}`).getAttribute("d")) ?? "";
    assert.ok(path.split("L").length > 20, `${curve}: ${path.slice(0, 60)}`);
  }
  await page.locator(".as-table summary").click();
  assert.ok((await page.locator(".as-table tbody tr").count()) > 10);
  await page.locator(".as-table summary").click();
  await keep(page, "desktop-slices");
});

test(
  "a slice is windowed, zoomed, moved and enlarged by the hands of other viewers, and says what is under the pointer",
  { skip, timeout: 600_000 },
  async () => {
    await reset();
    await page.locator(".layouts button[value=slices]").click();
    await page.waitForSelector(".slice.axial[data-position]");
    const frame = page.locator(".slice.axial .slice-view");
    const box = await frame.boundingBox();
    assert.ok(box);
    // A wheel event tells whole pixels.
    const [cx, cy] = [Math.round(box.x + box.width / 2), Math.round(box.y + box.height / 2)];
    const slider = await page.locator(".slice.axial .slice-range").boundingBox();
    const title = await page.locator(".slice.axial .pane-line").boundingBox();
    const button = await page.locator(".slice.axial .icon-button:last-child").boundingBox();
    for (const below of [slider, title, button])
      assert.ok(below && below.y >= box.y + box.height - 0.5, "slider, name and button lie below the picture");
    const asked = (): Promise<string> =>
      page.waitForRequest((request) => request.url().includes("/slices/axial")).then((request) => request.url());
    // The slice of the test before may be shown until this one's has come.
    const middle_mm = (await facts()).envelope_sphere.center_in_patient[2];
    await page.waitForFunction(
      (wished) => Number(document.querySelector<HTMLElement>(".slice.axial")?.dataset.position) === wished,
      middle_mm,
    );
    await page.mouse.move(cx + 20, cy + 10);
    await page.waitForFunction(() =>
      /^[LR]\s.* mm\s+depth .* mm\s+T1\s\d/.test(document.querySelector(".slice.axial .hovered")?.textContent ?? ""),
    );
    const words = await text(".slice.axial .hovered");
    const [read, scale] = [
      await page.locator(".slice.axial .hovered").boundingBox(),
      await page.locator(".slice.axial .scale").boundingBox(),
    ];
    assert.ok(read && scale && read.x >= scale.x + scale.width - 0.5, "it stands beside the scale, not over it");
    let waiting = asked();
    await page.keyboard.down("Control");
    await page.mouse.wheel(0, -300);
    await page.keyboard.up("Control");
    assert.match(await waiting, /zoom=1\.\d+&pan=/);
    await page.mouse.move(cx + 24, cy + 10);
    await page.mouse.move(cx + 20, cy + 10);
    await until(
      () => text(".slice.axial .hovered"),
      (now) => now !== "",
    );
    const held = (await text(".slice.axial .hovered")).split("\n")[0];
    assert.equal(held, words.split("\n")[0], "what is under the pointer stays there");
    await keep(page, "slice-zoomed");
    waiting = asked();
    await page.keyboard.down("Shift");
    await page.mouse.down();
    await page.mouse.move(cx + 50, cy + 30, { steps: 3 });
    await page.mouse.up();
    await page.keyboard.up("Shift");
    assert.match(await waiting, /pan=/);
    assert.equal((await fragment(page)).x, undefined, "no point was marked");
    await page.mouse.move(cx, cy);
    await page.mouse.down({ button: "right" });
    await page.mouse.move(cx + 60, cy, { steps: 3 });
    await page.mouse.up({ button: "right" });
    assert.ok((await fragment(page)).w, "the window is another one");
    await page.locator(".slice.axial").focus();
    waiting = asked();
    await page.keyboard.press("Home");
    assert.doesNotMatch(await waiting, /zoom=|pan=/);
    waiting = asked();
    await page.locator("#surface").focus();
    await page.keyboard.press("o");
    assert.doesNotMatch(await waiting, /depth_mm/);
    await page.keyboard.press("o");
    await page.locator(".slice.coronal .slice-bar > .icon-button:last-child").click();
    const panes = await page.locator(".panes").boundingBox();
    const large = await page.locator(".slice.coronal").boundingBox();
    assert.ok(panes && large && Math.abs(large.width - panes.width) < 2 && Math.abs(large.height - panes.height) < 2);
    await page.waitForFunction(() => {
      const image = document.querySelector<HTMLImageElement>(".slice.coronal .slice-image img");
      const frame = document.querySelector(".slice.coronal .slice-view");
      const box = image?.getBoundingClientRect();
      if (!image || !frame || !box || image.naturalWidth < 700) return false;
      const [across, down] = [box.width / image.naturalWidth, box.height / image.naturalHeight];
      return Math.abs(box.width - frame.clientWidth) < 2 && Math.abs(across / down - 1) < 0.01;
    });
    await keep(page, "slice-large");
    assert.ok((await text(".slice.coronal .pane-case")).endsWith(id.slice(0, 8)), "it names the case itself");
    await page.locator(".slice.coronal .slice-view").dblclick({ position: { x: 200, y: 200 } });
    assert.ok(((await page.locator(".slice.coronal").boundingBox())?.width ?? 9999) < panes.width / 2);
  },
);

/** How far the mark is from the middle of a slice, in CSS pixels. */
const offMiddle = async (plane: string): Promise<number> => {
  const [mark, frame] = [
    await page.locator(`.slice.${plane} .cursor.mark`).boundingBox(),
    await page.locator(`.slice.${plane} .slice-view`).boundingBox(),
  ];
  if (!mark || !frame) return NaN;
  const middle = (from: number, length: number): number => from + length / 2;
  return Math.hypot(
    middle(mark.x, mark.width) - middle(frame.x, frame.width),
    middle(mark.y, mark.height) - middle(frame.y, frame.height),
  );
};

test(
  "enlarged slices are brought to a place that is marked elsewhere, with one zoom until a switch parts them",
  { skip },
  async () => {
    await reset();
    await page.locator(".layouts button[value=slices]").click();
    await page.waitForSelector(".slice.axial[data-position]");
    const scales = (): Promise<string[]> => page.locator(".slice .scale-text").allInnerTexts();
    const zoom = async (plane: string): Promise<void> => {
      await page.locator(`.slice.${plane} .slice-view`).hover();
      await page.keyboard.down("Control");
      for (let notch = 0; notch < 3; notch += 1) await page.mouse.wheel(0, -300);
      await page.keyboard.up("Control");
    };
    const [whole = ""] = await scales();
    await zoom("axial");
    const together = await until(scales, (now) => !now.includes(whole) && new Set(now).size === 1);
    assert.equal(new Set(together).size, 1, together.join());
    const { x, y, width, height } = await surface();
    for (const across of [0.4, 0.55]) {
      await page.mouse.dblclick(x + width * across, y + height * 0.45);
      for (const plane of PLANES) {
        const off = await until(
          () => offMiddle(plane),
          (now) => now < 1,
        );
        assert.ok(off < 1, `${plane}: ${off}`);
      }
    }
    assert.deepEqual(await scales(), together, "the zoom stays");
    // A hand in one slice moves the others to the place, never its own.
    const axial = await page.locator(".slice.axial .slice-view").boundingBox();
    assert.ok(axial);
    await page.mouse.click(axial.x + axial.width / 2 + 40, axial.y + axial.height / 2 + 10);
    await until(
      () => offMiddle("axial"),
      (now) => now > 30,
    );
    assert.ok(Math.abs((await offMiddle("axial")) - Math.hypot(40, 10)) < 1.5);
    for (const plane of ["coronal", "sagittal"])
      assert.ok(
        (await until(
          () => offMiddle(plane),
          (now) => now < 1,
        )) < 1,
        plane,
      );
    // What is marked lies free, also without outlines.
    await page.keyboard.press("o");
    await page.waitForSelector(".panes[data-outlined=false]");
    assert.equal(await page.locator(".slice.axial .cursor.mark").isVisible(), true);
    await keep(page, "slices-centred");
    await page.keyboard.press("o");
    await inSettings(page, () => page.locator("#linked_zoom").uncheck());
    await zoom("coronal");
    const apart = await until(scales, (now) => new Set(now).size > 1);
    assert.deepEqual([apart[0], apart[2]], [together[0], together[2]]);
    assert.notEqual(apart[1], together[1]);
    await inSettings(page, () => page.locator("#linked_zoom").check());
    const again = await until(scales, (now) => new Set(now).size === 1);
    assert.deepEqual(again, [apart[1], apart[1], apart[1]]);
  },
);

test("the cross on a slice is that of the picture below it, which may come late", { skip }, async () => {
  await reset();
  await page.locator(".layouts button[value=slices]").click();
  const { x, y, width, height } = await surface();
  await page.mouse.dblclick(x + width * 0.45, y + height * 0.45);
  const marked = (await fragment(page)).x?.split(",")[2];
  await page.waitForSelector(`.slice.axial[data-position^="${Math.trunc(Number(marked))}."]`);
  const cross = (): Promise<unknown> => page.locator(".slice.axial .cursor.mark").boundingBox();
  await page.waitForSelector(".slice.axial .cursor.mark");
  const before = await cross();
  let release = (): void => {};
  const held = new Promise<void>((resolve) => (release = resolve));
  await page.route("**/slices/axial?*", async (route) => {
    await held;
    await route.continue();
  });
  await page.locator(".slice.coronal .slice-view").click({ position: { x: 180, y: 150 } });
  await fragment(page);
  assert.deepEqual(await cross(), before);
  release();
  const after = await until(cross, (now) => JSON.stringify(now) !== JSON.stringify(before));
  assert.notDeepEqual(after, before);
  await page.unroute("**/slices/axial?*");
});

test("controls that are folded stay so when the page is loaded again", { skip }, async () => {
  await reset();
  const fold = page.getByRole("button", { name: "Controls", exact: true });
  for (const isShown of [false, true]) {
    await fold.click();
    await page.reload();
    await shown(page);
    assert.equal(await page.locator(".panel").isVisible(), isShown);
    assert.equal(await fold.getAttribute("aria-expanded"), String(isShown));
  }
});

test("the surface is enlarged by its button, and Escape or a layout shows the slices again", { skip }, async () => {
  await reset();
  const surface = page.locator("#surface");
  const enlarge = surface.locator(".icon-button");
  assert.equal(await enlarge.isVisible(), false, "alone it is as large as it can be");
  const choose = page.locator(".layouts button[value=slices]");
  await choose.click();
  const width = async (): Promise<number> => (await surface.boundingBox())?.width ?? 0;
  const small = await width();
  for (const shrink of [() => page.keyboard.press("Escape"), () => choose.click(), () => enlarge.click()]) {
    await enlarge.click();
    await until(width, (now) => now > 1.3 * small);
    assert.equal(await page.locator(".slice.axial .icon-button:last-child").isVisible(), true, "only hidden below it");
    await shrink();
    await until(width, (now) => now === small);
  }
});

test(
  "a double click in a slice moves nothing, Escape shrinks it, and one step back undoes a drag",
  { skip },
  async () => {
    await reset();
    await page.locator(".layouts button[value=slices]").click();
    const before = await fragment(page);
    assert.equal(before.x, undefined);
    const slice = page.locator(".slice.coronal");
    await slice.locator(".slice-view").dblclick({ position: { x: 120, y: 100 } });
    assert.match((await slice.getAttribute("class")) ?? "", /large/);
    assert.deepEqual(await fragment(page), before, "nothing is marked or turned");
    await page.keyboard.press("Escape");
    assert.doesNotMatch((await slice.getAttribute("class")) ?? "", /large/);
    const box = await slice.boundingBox();
    assert.ok(box);
    await page.mouse.move(box.x + 60, box.y + 60);
    await page.mouse.down();
    await page.mouse.move(box.x + 90, box.y + 80);
    // A hand that pauses on its way makes no step of it.
    await page.waitForTimeout(800);
    await page.mouse.move(box.x + 110, box.y + 90);
    await page.mouse.up();
    assert.ok((await fragment(page)).x, "a point is marked");
    await page.keyboard.press("Control+z");
    assert.deepEqual(await fragment(page), before);
  },
);

test("a click in a slice turns the surface to that point", { skip }, async () => {
  await reset();
  await page.locator(".layouts button[value=slices]").click();
  const box = await page.locator(".slice.coronal").boundingBox();
  assert.ok(box);
  // At the picture's left is the patient's right.
  await page.mouse.click(box.x + box.width * 0.3, box.y + box.height * 0.4);
  const { x: marked = "", q, v } = await fragment(page);
  assert.ok(Number(marked.split(",")[0]) < -15, marked);
  assert.ok(q || v);
  const cube = page.locator("#surface .cube [data-view=right]");
  await cube.waitFor({ state: "attached" });
  assert.ok(Number(await cube.getAttribute("opacity")) > 0.6, "the right side is in front");
  const focused = (): Promise<boolean> =>
    page.evaluate(() => document.activeElement === document.querySelector(".slice.coronal"));
  assert.equal(await focused(), true, "its keys are those of the slice");
  const range = page.locator(".slice.axial .slice-range");
  // Only a click turns the surface: who goes through the slices keeps the view of it.
  await range.fill("20");
  const moved = await fragment(page);
  assert.deepEqual([moved.x?.split(",")[2], moved.q, moved.v], ["20", q, v]);
  await page.mouse.move(box.x + box.width * 0.3, box.y + box.height * 0.4);
  await page.mouse.wheel(0, -100);
  const stepped = await until(
    () => fragment(page),
    (now) => now.x !== moved.x,
  );
  const [before, after] = [moved, stepped].map(({ x }) => Number(x?.split(",")[1]));
  assert.ok(Math.abs((after ?? NaN) - (before ?? NaN) - 1) < 0.05, `${before} to ${after}`);
  assert.deepEqual([stepped.q, stepped.v], [q, v]);
});

test("the slice across the sulcus comes with a key, turns by hand, and marks what is clicked", { skip }, async () => {
  await reset();
  await page.keyboard.press("x");
  const said = await until(
    () => text("#live"),
    (words) => words.startsWith("Mark a point first"),
  );
  assert.match(said, /^Mark a point first/);
  await page.locator(".layouts button[value=slices]").click();
  const { x, y, width, height } = await surface();
  await page.mouse.dblclick(x + width * 0.45, y + height * 0.45);
  await page.getByRole("button", { name: "Slice across the sulcus", exact: true }).click();
  await page.waitForSelector(".slice.across[data-turn='0']");
  assert.match(await text(".slice.across .pane-title"), /^Across the sulcus\s(ax|cor|sag)( > (ax|cor|sag) -?\d+°)*$/);
  const marked = (await fragment(page)).x ?? "";
  assert.equal((await fragment(page)).u, "0");
  // The plane crosses at least two of three standard ones, and turns with the wheel.
  assert.ok((await page.locator(".slice .trace:not([hidden])").count()) >= 2);
  const frame = page.locator(".slice.across .slice-view");
  await frame.hover({ position: { x: 30, y: 30 } });
  await page.mouse.wheel(0, -120);
  await page.waitForSelector(".slice.across[data-turn='5']");
  await page.locator(".slice.across").focus();
  await page.keyboard.press("Shift+ArrowDown");
  await page.waitForSelector(".slice.across[data-turn='4']");
  await keep(page, "slice-across");
  assert.deepEqual(await violations(page), []);
  // A handle brings the plane to where it is dragged: a quarter of a turn about the mark.
  const grip = page.locator(".slice.sagittal .trace:not([hidden]) .grip:not([hidden])").first();
  const [cross, from] = [await page.locator(".slice.sagittal .cursor.mark").boundingBox(), await grip.boundingBox()];
  assert.ok(cross && from);
  const middleOf = (box: typeof from): readonly [number, number] => [box.x + box.width / 2, box.y + box.height / 2];
  const [[mx, my], [gx, gy]] = [middleOf(cross), middleOf(from)];
  await page.mouse.move(gx, gy);
  await page.mouse.down();
  await page.mouse.move(mx - (gy - my), my + (gx - mx), { steps: 4 });
  await page.mouse.up();
  const turned = Number(
    (
      await until(
        () => fragment(page),
        ({ u }) => u !== "4",
      )
    ).u,
  );
  assert.ok(Math.abs(turned - 4) > 45, `turned to ${turned}`);
  await page.waitForSelector(`.slice.across[data-turn='${turned}']`);
  assert.equal((await fragment(page)).x, marked, "a handle marks nothing");
  // A click marks the point of the plane: the slices go through it.
  const box = await frame.boundingBox();
  assert.ok(box);
  await page.mouse.click(box.x + box.width / 2 + 20, box.y + box.height / 2 + 20);
  const after = await until(
    () => fragment(page),
    (now) => now.x !== marked,
  );
  const away = Math.hypot(
    ...[0, 1, 2].map((axis) => Number(after.x?.split(",")[axis]) - Number(marked.split(",")[axis])),
  );
  assert.ok(away > 3 && away < 60, `${away} mm`);
  await page.locator(".slice.across").getByRole("button", { name: "Hide" }).click();
  await page.locator(".slice.across").waitFor({ state: "detached" });
  assert.equal((await fragment(page)).u, undefined);
});

test("on a phone fingers turn the slice across the sulcus, move a slice, measure, and mark", { skip }, async () => {
  const phone = { viewport: { width: 390, height: 844 }, deviceScaleFactor: 3, hasTouch: true, isMobile: true };
  const { page: small, context, troubles } = await openPage(browser, phone);
  await small.goto(`${demo?.origin}#${id}&l=slices&x=40,10,45&u=0`);
  await shown(small);
  await small.waitForSelector(".slice.across[data-turn='0']");
  const session = await context.newCDPSession(small);
  type Place = readonly [number, number];
  const touch = (type: "touchStart" | "touchMove" | "touchEnd", places: readonly Place[] = []): Promise<unknown> =>
    session.send("Input.dispatchTouchEvent", { type, touchPoints: places.map(([x, y], at) => ({ x, y, id: at })) });
  /** Drags fingers from places to others; a scroller that takes the gesture away does it after the first steps. */
  const drag = async (from: readonly Place[], to: readonly Place[]): Promise<void> => {
    await touch("touchStart", from);
    for (const share of [0.2, 0.4, 0.6, 0.8, 1]) {
      const along = ([x, y]: Place, at: number): Place => {
        const [endX, endY] = to[at] ?? [x, y];
        return [x + share * (endX - x), y + share * (endY - y)];
      };
      await touch("touchMove", from.map(along));
    }
    await touch("touchEnd");
  };
  const middleOf = async (selector: string): Promise<Place> => {
    const box = await small.locator(selector).first().boundingBox();
    assert.ok(box, selector);
    return [box.x + box.width / 2, box.y + box.height / 2];
  };
  const see = (selector: string): Promise<void> =>
    small.locator(selector).evaluate((one) => one.scrollIntoView({ block: "center" }));
  const scrolled = (): Promise<number> => small.locator(".page").evaluate((one) => one.scrollTop);

  // A handle goes up and down with the finger, which elsewhere on a slice scrolls the page.
  await see(".slice.axial");
  const top = await scrolled();
  const grip = ".slice.axial .trace:not([hidden]) .grip:not([hidden])";
  await small.locator(grip).first().waitFor();
  const [[gx, gy], [mx, my]] = [await middleOf(grip), await middleOf(".slice.axial .cursor.mark")];
  await drag([[gx, gy]], [[mx - (gy - my), my + (gx - mx)]]);
  const { u, x } = await until(
    () => fragment(small),
    (now) => now.u !== "0",
  );
  assert.ok(Math.abs(Number(u)) > 40, `turned to ${u}`);
  assert.equal(x, "40,10,45", "a handle marks nothing");
  assert.equal(await scrolled(), top, "the page is where it was");

  // Two fingers move a slice, also up and down.
  const [cx, cy] = await middleOf(".slice.axial .slice-view");
  const [left, right]: Place[] = [
    [cx - 40, cy],
    [cx + 40, cy],
  ];
  assert.ok(left && right);
  await drag(
    [left, right],
    [
      [left[0], left[1] + 50],
      [right[0], right[1] + 50],
    ],
  );
  const moved = async (): Promise<number> => (await middleOf(".slice.axial .cursor.mark"))[1] - my;
  const by = await until(moved, (pixels) => pixels > 30);
  assert.ok(by > 30 && by < 60, `moved by ${by} pixels`);
  assert.equal(await scrolled(), top, "the page is where it was");

  // Taps set the corners of an area, on a slice and on the surface; the last one again ends it.
  await small.locator("[popovertarget=menu-ruler]").tap();
  await small.getByRole("button", { name: "Area", exact: true }).tap();
  for (const [count, pane] of [".slice.axial .slice-view", "#surface"].entries()) {
    await see(pane);
    const [px, py] = await middleOf(pane);
    for (const [dx, dy] of [
      [-30, -40],
      [20, -40],
      [20, 0],
      [-30, 0],
      [-30, 0],
    ] as const)
      await small.touchscreen.tap(px + dx, py + dy);
    const areas = small.locator(".measures li[data-tool=area]");
    await areas.nth(count).waitFor({ state: "attached" });
    assert.equal(await areas.count(), count + 1);
  }
  assert.match(await small.locator(".measures li .value").last().innerText(), /^Area \d+ mm² along the surface/);
  await small.locator("[popovertarget=menu-ruler]").tap();
  await small.getByRole("button", { name: "Area", exact: true }).tap();

  // The depth follows a finger, and a double tap marks a point of the surface.
  const track = await small.locator("#depth").boundingBox();
  assert.ok(track);
  const middle = track.y + track.height / 2;
  await drag([[track.x + 0.25 * track.width, middle]], [[track.x + 0.5 * track.width, middle]]);
  const deep = async (): Promise<number> => Number((await fragment(small)).d ?? 10);
  assert.ok((await until(deep, (depth_mm) => depth_mm > 15)) > 15);
  await see("#surface");
  const [sx, sy] = await middleOf("#surface");
  for (let taps = 0; taps < 2; taps += 1) await small.touchscreen.tap(sx, sy);
  const marked = await until(
    () => fragment(small),
    (now) => now.x !== x,
  );
  assert.ok(marked.x && marked.x !== x, "a point is marked");
  await keep(small, "phone-touch");
  // The plane is asked for again until the maps are made.
  assert.deepEqual(
    troubles.filter((one) => !one.includes("409")),
    [],
  );
  await context.close();
});

test("slices are radiological until the other convention is chosen, and say which", { skip }, async () => {
  await reset();
  await page.locator(".layouts button[value=slices]").click();
  await page.waitForSelector(".slice.axial img");
  assert.equal(await letters(".slice.axial"), "R L A P");
  assert.equal(await letters(".slice.coronal"), "R L S I");
  assert.equal(await letters(".slice.sagittal"), "A P S I");
  assert.equal(await text(".slice.axial .badge"), "Radiological");
  await inSettings(page, () => page.locator("#convention").selectOption("neurological"));
  for (const plane of ["axial", "coronal"])
    await page.waitForSelector(`.slice.${plane} .slice-image.flipped`, { state: "attached" });
  assert.equal(await letters(".slice.axial"), "L R A P");
  assert.equal(await text(".slice.coronal .badge"), "Neurological");
  assert.equal(await page.locator(".slice.sagittal .badge").isVisible(), false);
  assert.equal(await page.locator(".slice.axial .slice-image.flipped").count(), 1);
  await inSettings(page, () => page.locator("#convention").selectOption("radiological"));
});

test("a late answer never stands over a newer one", { skip }, async () => {
  await reset();
  await page.locator(".layouts button[value=slices]").click();
  await page.waitForSelector(".slice.axial img");
  let held = 0;
  await page.route("**/slices/axial?*", async (route) => {
    // The first answer is the last to come.
    if ((held += 1) === 1) await new Promise((resolve) => setTimeout(resolve, 1200));
    await route.continue();
  });
  for (const value of [9, 12, 11.5]) await typeDepth(page, value);
  await page.waitForSelector(".slice.axial[data-depth='11.5']");
  await page.waitForTimeout(600);
  assert.equal(await page.locator(".slice.axial").getAttribute("data-depth"), "11.5");
  assert.ok(held <= 2, `${held} requests: wishes in between are not asked for`);
  await page.unroute("**/slices/axial?*");
});

async function facts(): Promise<ReadyCase> {
  return (await (await fetch(new URL(`v1/cases/${id}`, server.address))).json()) as ReadyCase;
}

/** A page that draws the slices of a state itself. */
async function drawnByPage(rest: string): Promise<Watched> {
  const opened = await openPage(browser, { viewport: { width: 1400, height: 900 } });
  await opened.page.goto(`${new URL("/", server.address)}#${id}&l=slices`);
  await opened.page.waitForSelector("canvas.cortex[data-whole=true]", { state: "attached" });
  await opened.page.evaluate((hash) => (location.hash = hash), `#${id}&l=slices${rest}`);
  for (const plane of PLANES) await opened.page.waitForSelector(`.slice.${plane}[data-way=page]`);
  return opened;
}

/** What a slice's canvas shows, and where the server draws the same. */
async function sliceOf(other: Page, plane: string): Promise<{ readonly own: string; readonly size: string }> {
  return other
    .locator(`.slice.${plane} .slice-image canvas`)
    .evaluate((canvas: HTMLCanvasElement) => ({
      own: canvas.toDataURL(),
      size: `width=${canvas.width}&height=${canvas.height}`,
    }));
}

test(
  "once the page has the whole volume it draws the slices as the server does, without asking it",
  { skip, timeout: 600_000 },
  async () => {
    const { page: own, troubles, context } = await drawnByPage("&d=12&x=-20,10,-15&o=5,20");
    const asked: string[] = [];
    own.on("request", (request) => asked.push(new URL(request.url()).pathname));
    const table: string[] = [];
    const compare = async (what: string, query: string, positions: readonly number[]): Promise<void> => {
      for (const [at, plane] of PLANES.entries()) {
        // Until the slice follows, the canvas shows what was asked for before.
        const followed = async (): Promise<number> => {
          const { own: picture, size } = await sliceOf(own, plane);
          const address = `/v1/cases/${id}/slices/${plane}?position_mm=${positions[at]}&${query}&${size}`;
          return picturesAgree(own, picture, address);
        };
        const share = await until(followed, (alike) => alike >= 0.99, 60);
        table.push(`${what}, ${plane}: ${(100 * share).toFixed(2)} %`);
        assert.ok(share >= 0.99, table.at(-1));
      }
    };
    const { center, width } = (await facts()).intensity.window;
    await compare("three contours", `depth_mm=12,5,20&window=${center},${width}`, [-15, 10, -20]);
    // The slice at another position is another picture, so that the comparison can fail.
    const { own: picture, size } = await sliceOf(own, "axial");
    const wrong = `/v1/cases/${id}/slices/axial?position_mm=-5&depth_mm=12,5,20&window=${center},${width}&${size}`;
    assert.ok((await picturesAgree(own, picture, wrong)) < 0.95);
    asked.length = 0;
    // Below the brain, where only the whole volume holds anything.
    const range = own.locator(".slice.axial .slice-range");
    await range.fill("-70");
    await own.waitForSelector(".slice.axial[data-position='-70']");
    assert.equal(await own.locator(".slice.axial").getAttribute("data-way"), "page");
    assert.deepEqual(
      asked.filter((path) => path.includes("/slices/")),
      [],
    );
    await compare("the face", `depth_mm=12,5,20&window=${center},${width}`, [-70, 10, -20]);
    await own.locator(".slice.axial").focus();
    await own.keyboard.press("ArrowUp");
    await own.waitForSelector(".slice.axial[data-position='-69']");
    await own.locator("#surface").focus();
    await own.keyboard.press("o");
    await own.waitForFunction(() => document.querySelector<HTMLElement>(".panes")?.dataset.outlined === "false");
    await compare("no contours", `window=${center},${width}`, [-69, 10, -20]);
    await own.keyboard.press("o");
    console.log(table.join("\n"));
    await keep(own, "slices-of-the-page");
    assert.deepEqual(troubles, []);
    await context.close();
  },
);

test("beside a cut through the brain outlines end, and no depth is said", { skip, timeout: 600_000 }, async () => {
  // The volume ends 26 mm above the lowest place of the brain.
  const values = (mark: number) => (x: number, y: number, z: number) => (isBrain(x, y, z + 40) ? mark : 0);
  const cut = await sendCase(server, { volume: nifti(values(300)), mask: nifti(values(1)) });
  const state = (await (await fetch(new URL(`v1/cases/${cut}`, server.address))).json()) as ReadyCase;
  assert.deepEqual(
    state.cuts?.map(({ normal }) => normal),
    [[0, 0, 1]],
    JSON.stringify(state),
  );
  const { page: own, troubles, context } = await openPage(browser, { viewport: { width: 1400, height: 900 } });
  // The case's own window is a step at the brain's only value.
  const window = "151,301";
  await own.goto(`${new URL("/", server.address)}#${cut}&l=slices&d=12&o=5,20&x=0,0,-50&w=${window}`);
  await own.waitForSelector(".slice.coronal[data-way=page][data-depth='12'][data-position='0']");
  const { size } = await sliceOf(own, "coronal");
  const query = `position_mm=0&depth_mm=12,5,20&window=${window}&${size}`;
  const alike = await until(
    async () => picturesAgree(own, (await sliceOf(own, "coronal")).own, `/v1/cases/${cut}/slices/coronal?${query}`),
    (share) => share >= 0.99,
    60,
  );
  assert.ok(alike >= 0.99, String(alike));
  // Below the middle of the picture only the sides have outlines; a whole brain has them in its middle column, too.
  const colored = await own.locator(".slice.coronal .slice-image canvas").evaluate((canvas: HTMLCanvasElement) => {
    const [middle, half] = [Math.floor(canvas.width / 2), Math.floor(canvas.height / 2)];
    const data = canvas.getContext("2d")?.getImageData(middle, 0, 1, canvas.height).data ?? new Uint8ClampedArray();
    const rows = Array.from({ length: canvas.height }, (_, row) => row);
    const isColored = (row: number): boolean => Math.abs((data[4 * row] ?? 0) - (data[4 * row + 2] ?? 0)) > 40;
    return [rows.filter((row) => row < half && isColored(row)), rows.filter((row) => row >= half && isColored(row))];
  });
  assert.ok((colored[0]?.length ?? 0) >= 3, String(colored[0]));
  assert.deepEqual(colored[1], []);
  const words = await until(
    async () => (await own.locator("dl.point:not(.case-facts)").textContent()) ?? "",
    (now) => now.includes("–"),
    60,
  );
  assert.match(words, /Depth–/);
  assert.deepEqual(troubles, []);
  await context.close();
});

test("a lost context leaves the slices to the server, and takes them back", { skip, timeout: 600_000 }, async () => {
  const { page: own, context } = await drawnByPage("&x=-20,10,-15");
  await own.evaluate(() => {
    const gl = document.querySelector<HTMLCanvasElement>("canvas.cortex")?.getContext("webgl2");
    const losing = gl?.getExtension("WEBGL_lose_context");
    losing?.loseContext();
    setTimeout(() => losing?.restoreContext(), 1500);
  });
  await own.waitForSelector(".viewer[data-fallback=context-lost]");
  await own.locator(".slice.axial .slice-range").fill("30");
  await own.waitForSelector(".slice.axial[data-way=server]");
  await own.waitForSelector(".viewer[data-fallback='']");
  await own.locator(".slice.axial .slice-range").fill("31");
  await own.waitForSelector(".slice.axial[data-way=page]");
  await context.close();
});

test("nothing failed, and nothing broke the content security policy", { skip }, () => {
  assert.deepEqual(watched.troubles, []);
});
