import assert from "node:assert/strict";
import { test } from "node:test";

import tables from "../shaders/colors.json";
import { Problem } from "../src/base/api.ts";
import { colorRow } from "../src/gl/colors.ts";
import { NAMED_VIEWS, facing, project, towardsViewer } from "../src/model/camera.ts";
import { broughtInside, broughtTo, changeOf, innerSideOf, laidOut } from "../src/model/commands.ts";
import { commandOf } from "../src/model/keys.ts";
import { readState, writeAddress } from "../src/model/fragment.ts";
import {
  MAP_NAMES,
  type LayerOverlay,
  firstOverlay,
  overlayText,
  readOverlay,
  shareOf,
  styleOfMap,
  toggled,
} from "../src/model/maps.ts";
import { sideOf, sideSeen } from "../src/model/midsagittal.ts";
import { renderQuery, sliceQuery } from "../src/model/query.ts";
import { turnBody } from "../src/model/series.ts";
import { type Vec3, dot, normalized, subtract, PLANE_NAMES } from "../src/model/space.ts";
import { type ViewState, firstState } from "../src/model/state.ts";
import { effect } from "@preact/signals";
import { CaseLayers } from "../src/store/case-layers.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);

test("a map comes back from the address, which names only what is not as at first", () => {
  for (const name of MAP_NAMES) {
    const first = firstOverlay(name);
    const other: LayerOverlay = { ...first, threshold: first.threshold === null ? null : 3.4, opacity: 0.4 };
    assert.equal(overlayText(first), name);
    for (const overlay of [first, other]) {
      const state: ViewState = { ...FIRST, overlay };
      const rest = writeAddress(state, SHOWN).split("&").slice(1).join("&");
      assert.deepEqual(readState(rest, SHOWN), { state, unread: [] }, rest);
    }
  }
  assert.equal(overlayText({ name: "blur", threshold: 3, opacity: 0.85 }), "blur,3");
  assert.equal(overlayText({ name: "sharpness", threshold: null, opacity: 0.5 }), "sharpness,,0.5");
});

test("what of an address is no map is named, and nothing of it is drawn", () => {
  for (const text of [
    "",
    "lesion",
    "blur,9",
    "blur,x",
    "blur,3,2",
    "blur,3,0.5,1",
    "blur,,,3,2",
    "blur,,,,,pink",
    "sharpness,3",
    "toString",
  ]) {
    const { state, unread } = readState(`b=${text}`, SHOWN);
    assert.deepEqual(unread, [`b=${text}`]);
    const overlay = state.overlay;
    assert.ok(overlay === null || readOverlay(overlayText(overlay))?.isWhole, text);
  }
  assert.deepEqual(readOverlay("blur,9,-1")?.overlay, { name: "blur", threshold: 6, opacity: 0 });
});

test("each map has a key, which shows it and hides it again, as a step of its own", () => {
  const key = (letter: string) =>
    commandOf({ key: letter, code: "", shiftKey: letter === "F", altKey: false, ctrlKey: false, metaKey: false });
  const names = ["u", "y", "f", "a", "t", "s", "j"].map((letter) => {
    const command = key(letter);
    assert.ok(command?.kind === "map", letter);
    const shown = changeOf(command, FIRST, SHOWN, [100, 100]);
    assert.deepEqual(shown, { change: { overlay: firstOverlay(command.name) }, isStep: true });
    const hidden = changeOf(command, { ...FIRST, ...shown.change }, SHOWN, [100, 100]);
    assert.deepEqual(hidden.change, { overlay: null });
    return command.name;
  });
  assert.deepEqual(names, [...MAP_NAMES]);
  assert.deepEqual(toggled(firstOverlay("blur"), firstOverlay("junction")), firstOverlay("junction"));
});

test("a map fades in above its threshold, of magnitudes where its colours diverge, as the server's", () => {
  const blur = firstOverlay("blur");
  assert.equal(shareOf(blur, 2.5), 0);
  assert.ok(Math.abs(shareOf(blur, 2.625) - 0.85 / 2) < 1e-6);
  assert.equal(shareOf(blur, 2.9), 0.85);
  assert.equal(shareOf(blur, -5), 0);
  assert.equal(shareOf(firstOverlay("asymmetry"), -5), 0.85);
  assert.equal(shareOf(firstOverlay("sharpness"), 0), 0.85);
});

test("every picture of the server's has the map, and none has a key without one", () => {
  const state: ViewState = { ...FIRST, overlay: { name: "blur", threshold: 3, opacity: 0.5 } };
  const queries = (of: ViewState): URLSearchParams[] => [
    renderQuery(of, [64, 48]),
    ...PLANE_NAMES.map((plane) => sliceQuery(of, plane, [0, 0, 0], [64, 48])),
  ];
  for (const query of queries(state)) {
    const pairs = [...query].filter(([key]) => key.startsWith("overlay"));
    assert.deepEqual(Object.fromEntries(pairs), { overlay: "blur", overlay_threshold: "3", overlay_opacity: "0.5" });
  }
  for (const query of queries(FIRST)) assert.doesNotMatch(query.toString(), /overlay/);
  const sharp = renderQuery({ ...FIRST, overlay: firstOverlay("sharpness") }, [64, 48]);
  assert.equal(sharp.has("overlay_threshold"), false);
  const { render } = (turnBody(state, 4, 10, [64, 48]) as { swivel: { render: Record<string, unknown> } }).swivel;
  assert.deepEqual([render.overlay, render.overlay_threshold, render.overlay_opacity], ["blur", 3, 0.5]);
});

test("every map has colours that the page has", () => {
  for (const name of MAP_NAMES)
    assert.ok(colorRow(styleOfMap(name).colormap) >= 0 && styleOfMap(name).colormap in tables);
});

/** How near a position is to the middle of a view: the cosine of its direction from the head's middle to the viewer's. */
function projectedTowards({ orientation }: Partial<ViewState>, position: Vec3): number {
  assert.ok(orientation);
  return dot(normalized(subtract(position, SHOWN.envelope_sphere.center_in_patient)), towardsViewer(orientation));
}

test("a place is brought to the middle and marked; its own hemisphere is the one that is not flipped", () => {
  const right = [-40, 20, 35] as const;
  const plain = broughtTo(right, 99, "single", SHOWN);
  assert.deepEqual([plain.depth_mm, plain.crosshair_mm, plain.layout], [41.23, right, "single"]);
  assert.ok(projectedTowards(plain, right) > 0.99);
  const beside = broughtTo(right, 12, "mirror", SHOWN);
  assert.deepEqual(beside.crosshair_mm, right);
  assert.ok(projectedTowards(beside, right) > 0.99);
  const left = broughtTo([40, 20, 35], 12, "both", SHOWN);
  assert.ok(projectedTowards(left, [40, 20, 35]) > 0.99);
});

test("a place of the mesial wall, or deep beside it, is shown on the inner side of its own half", () => {
  // 6 mm to the left of the plane between the halves: 20 mm below the dura, it is far nearer to the other half.
  const left = [6, 20, 60] as const;
  assert.equal(innerSideOf(left, 20, SHOWN), "left");
  assert.equal(innerSideOf([-6, 20, 60], 20, SHOWN), "right");
  assert.equal(innerSideOf(left, 8, SHOWN), null, "the cut through the whole brain shows it");
  assert.equal(innerSideOf([25, 20, 20], 35, SHOWN), "left", "too deep for the whole brain, and nearer to the plane");
  assert.equal(innerSideOf([38, 20, 20], 33, SHOWN), null, "an insula: the slices show it");
  const { surface, orientation, pan_mm, depth_mm, crosshair_mm } = broughtInside(
    { position: left, half: "left", depth_mm: 6 },
    { zoom: 2, layout: "single" },
    SHOWN,
  );
  assert.deepEqual([surface, depth_mm, crosshair_mm], ["left", 6, left]);
  assert.ok(orientation && pan_mm);
  assert.ok(dot(towardsViewer(orientation), [-1, 0, 0]) > 0.99, "the viewer is at the patient's right");
  const [x, y] = project({ orientation, pan_mm, zoom: 2 }, SHOWN.envelope_sphere, [400, 300]).pixelOf(left);
  assert.ok(Math.hypot(x - 200, y - 150) < 1e-6, "it is in the middle");
});

test("the mirror layout shows the marked hemisphere as it was acquired; without a mark, the left one", () => {
  const first = firstState(SHOWN);
  const plane = SHOWN.midsagittal;
  const seen = (state: ViewState): string => {
    const { orientation } = { ...state, ...laidOut("mirror", state, SHOWN) };
    return sideSeen(towardsViewer(orientation), plane);
  };
  assert.equal(seen({ ...first, orientation: NAMED_VIEWS.right }), "left");
  assert.equal(seen({ ...first, crosshair_mm: [-40, 20, 35] }), "right");
  assert.equal(seen({ ...first, orientation: NAMED_VIEWS.right, crosshair_mm: [40, 20, 35] }), "left");
  // A view that has it in sight stays.
  const oblique = { ...first, orientation: facing([-0.5, -0.8, 0.2]), crosshair_mm: [-40, 20, 35] } as const;
  assert.equal(laidOut("both", oblique, SHOWN).orientation, undefined);
});

test("within 5 mm of the plane a position is in the middle, and a view along it shows both sides", () => {
  const plane = { normal: [1, 0, 0], offset_mm: 2 } as const;
  assert.deepEqual(
    [
      [7, 0, 0],
      [7.1, 0, 0],
      [-3, 9, 9],
      [-3.1, 9, 9],
    ].map((place) => sideOf(place as unknown as Vec3, plane)),
    ["middle", "left", "middle", "right"],
  );
  // Of the right half alone, the plane lies within that half.
  const within = { normal: [1, 0, 0], offset_mm: -35, doubtful: true } as const;
  const sides = [30, 0, -20, -60].map((x) => sideOf([x, 0, 0], within));
  assert.deepEqual(sides, ["left", "unknown", "unknown", "right"]);
  assert.deepEqual(
    (["left", "right", "superior", "anterior"] as const).map((name) =>
      sideSeen(towardsViewer(NAMED_VIEWS[name]), plane),
    ),
    ["left", "right", "middle", "middle"],
  );
});

const answer = (status: number, body: unknown, headers: Record<string, string> = {}): Response =>
  new Response(body instanceof Uint8Array ? body.slice() : JSON.stringify(body), {
    status,
    headers: { "content-type": "application/problem+json", ...headers },
  });

const listed = (state: string, extra: object = {}): object => ({
  layers: MAP_NAMES.map((name) => ({ id: name, name, kind: "map", unit: "z", state, ...extra })),
  junction_by_depth: [],
});

test("maps that are being made are asked for until they are ready, and fetched once", async (context) => {
  const told: string[] = [];
  const asked: string[] = [];
  const states = ["making", "ready"];
  const volumes = [
    answer(409, { type: "urn:isocortex:problem:layer-not-ready" }, { "retry-after": "0.01" }),
    answer(200, new Uint8Array([0, 7]), {
      "x-isocortex-size": "2,1,1",
      "x-isocortex-format": "u8",
      "x-isocortex-scale": "0.1",
      "x-isocortex-offset": "-12.8",
      "x-isocortex-patient-from-voxel": "1,0,0,0,0,1,0,0,0,0,1,0",
    }),
  ];
  context.mock.method(globalThis, "fetch", async (path: string) => {
    asked.push(path);
    return (path.endsWith("/volume") ? volumes.shift() : null) ?? answer(200, listed(states.shift() ?? "ready"));
  });
  const layers = new CaseLayers(SHOWN.id);
  effect(() => void layers.list.value?.layers.slice(0, 1).map(({ state }) => told.push(state)));
  await Promise.all([layers.ask(), layers.ask()]);
  assert.deepEqual([told, layers.ready("blur")?.name, asked.length], [["making", "ready"], "blur", 2]);
  const [one, two] = await Promise.all([layers.voxels("blur"), layers.voxels("blur")]);
  assert.equal(one, two);
  assert.deepEqual([...one.voxels], [0, 7]);
  assert.equal(asked.length, 4);
  await layers.ask();
  assert.equal(asked.length, 4);
  await layers.again();
  assert.equal(asked.length, 5);
});

test("a head without maps says why, and its layers are not waited for", async (context) => {
  const reason = "the largest voxel spacing is 4.00 mm";
  context.mock.method(globalThis, "fetch", async (path: string) =>
    path.endsWith("/volume")
      ? answer(409, { type: "urn:isocortex:problem:maps-undefined", detail: reason })
      : answer(200, listed("undefined", { reason })),
  );
  const told: unknown[] = [];
  const layers = new CaseLayers(SHOWN.id);
  effect(() => void layers.list.value?.layers.slice(0, 1).map((map) => told.push(map.state, map.reason)));
  await layers.ask();
  assert.deepEqual([told, layers.ready("blur")], [["undefined", reason], null]);
  await assert.rejects(layers.voxels("blur"), (problem) => problem instanceof Problem && problem.detail === reason);
});
