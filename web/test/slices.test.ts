import assert from "node:assert/strict";
import { test } from "node:test";

import { facesOf } from "../src/panes/cube.ts";
import { NAMED_VIEWS } from "../src/model/camera.ts";
import { pictureSize, renderQuery, sliceQuery } from "../src/model/query.ts";
import { imageWords } from "../src/panes/slice-words.ts";
import { speak, type Words } from "../src/base/i18n.ts";
import { depthAtWords, positionWords, scaleBar, voxelAt } from "../src/base/readout.ts";
import english from "../src/words.en.json";
import portuguese from "../src/words.pt-BR.json";
import type { ReadyCase } from "../src/model/case.ts";
import {
  CENTRED,
  type SliceView,
  followedSlice,
  laid,
  movedSlice,
  reachOf,
  sliceEdges,
  slicePixel,
  slicePosition,
  withinReach,
  zoomedSlice,
} from "../src/model/slice-geometry.ts";
import { type Vec3, PLANE_NAMES } from "../src/model/space.ts";
import { firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const SPHERE = SHOWN.envelope_sphere;
const view = (change: Partial<SliceView>): SliceView => ({
  plane: "axial",
  convention: "radiological",
  position_mm: 12,
  size: [300, 200],
  placing: CENTRED,
  ...change,
});

test("the patient's right is at the picture's left, unless the other convention is chosen", () => {
  const right = [-40, 20, 12] as const;
  assert.ok(slicePixel(view({}), SPHERE, right)[0] < 150);
  assert.ok(slicePixel(view({ plane: "coronal" }), SPHERE, right)[0] < 150);
  assert.ok(slicePixel(view({ convention: "neurological" }), SPHERE, right)[0] > 150);
  assert.deepEqual(sliceEdges("axial", "radiological"), { left: "R", right: "L", top: "A", bottom: "P" });
  assert.deepEqual(sliceEdges("axial", "neurological"), { left: "L", right: "R", top: "A", bottom: "P" });
  assert.deepEqual(sliceEdges("coronal", "radiological"), { left: "R", right: "L", top: "S", bottom: "I" });
  for (const convention of ["radiological", "neurological"] as const) {
    assert.deepEqual(sliceEdges("sagittal", convention), { left: "A", right: "P", top: "S", bottom: "I" });
  }
});

test("a click in a slice is the position that is seen there", () => {
  for (const plane of PLANE_NAMES) {
    for (const convention of ["radiological", "neurological"] as const) {
      const slice = view({ plane, convention, position_mm: 7 });
      const position = slicePosition(slice, SPHERE, [211, 57]);
      assert.ok(position.includes(7));
      const [x, y] = slicePixel(slice, SPHERE, position);
      assert.ok(Math.hypot(x - 211, y - 57) < 1e-9, `${plane} ${convention}`);
    }
  }
});

test("a slice is enlarged about the pointer and moved with the hand, in either convention", () => {
  for (const plane of PLANE_NAMES) {
    for (const convention of ["radiological", "neurological"] as const) {
      const slice = view({ plane, convention, position_mm: 7 });
      const held = slicePosition(slice, SPHERE, [211, 57]);
      const large = { ...slice, placing: zoomedSlice(slice, SHOWN, 2.5, [211, 57]) };
      assert.equal(large.placing.zoom, 2.5);
      const [x, y] = slicePixel(large, SPHERE, held);
      assert.ok(Math.hypot(x - 211, y - 57) < 1e-6, `${plane} ${convention}: what is under the pointer stays there`);
      const moved = { ...large, placing: movedSlice(large, SHOWN, [-30, 12]) };
      const [right, down] = slicePixel(moved, SPHERE, held);
      assert.ok(Math.hypot(right - 181, down - 69) < 1e-6, `${plane} ${convention}: it follows the hand`);
      // The picture of before, laid as now, has every place where it is now.
      const { scale, move } = laid(slice, moved, SPHERE);
      const place = slicePosition(slice, SPHERE, [40, 150]);
      const [before, now] = [slicePixel(slice, SPHERE, place), slicePixel(moved, SPHERE, place)];
      const found = [0, 1].map((axis) => {
        const middle = (slice.size[axis] ?? 0) / 2;
        return middle + ((before[axis] ?? 0) - middle) * scale + (move[axis] ?? 0);
      });
      assert.ok(Math.hypot((found[0] ?? 0) - now[0], (found[1] ?? 0) - now[1]) < 1e-6, `${plane} ${convention}`);
    }
  }
});

test("an enlarged slice is brought to a mark, which lies in its middle; a whole head stays where it is", () => {
  const { center_in_patient: middle } = SHOWN.envelope_sphere;
  for (const convention of ["radiological", "neurological"] as const) {
    const near = view({ convention, placing: { zoom: 4, pan_mm: [0, 0] } });
    // One is in sight, the other is not.
    for (const across of [-4, -60]) {
      const mark: Vec3 = [middle[0] + across, middle[1] + 3, middle[2]];
      const placing = followedSlice(near, SHOWN, mark);
      assert.equal(placing.zoom, 4);
      const [x, y] = slicePixel({ ...near, placing }, SPHERE, mark);
      assert.ok(Math.hypot(x - near.size[0] / 2, y - near.size[1] / 2) < 0.01, `${x}, ${y}`);
    }
    const whole = view({ convention });
    assert.equal(followedSlice(whole, SHOWN, [middle[0] - 4, middle[1] + 3, middle[2]]), whole.placing);
  }
});

test("a picture of a smaller pane, laid in a larger one, shows every place where it is", () => {
  const small = view({ placing: { zoom: 2, pan_mm: [5, -3] } });
  const large = { ...small, size: [900, 500] as const };
  const { scale, move } = laid(small, large, SPHERE);
  const place = slicePosition(small, SPHERE, [40, 150]);
  const now = slicePixel(large, SPHERE, place);
  // About the middle of the pane, as large as it was drawn.
  const [x, y] = [(40 - 150) * scale + 450 + move[0], (150 - 100) * scale + 250 + move[1]];
  assert.ok(Math.hypot(x - now[0], y - now[1]) < 1e-6);
});

test("positions stay within the volume as acquired", () => {
  assert.deepEqual(reachOf(SHOWN, 0), [-54, 55]);
  assert.deepEqual(withinReach(SHOWN, [-999, 3, 999]), [-54, 3, 63]);
});

test("a position is told by its sides, and by its voxel as acquired", () => {
  assert.equal(positionWords([-10.04, 3, -0.5]), "R\u00a010.0 · P\u00a03.0 · I\u00a00.5");
  assert.deepEqual(voxelAt(SHOWN, [5, 80, 15]), [50, 5, 25]);
  assert.equal(voxelAt(SHOWN, [500, 0, 0]), null);
  speak("en", english as Words);
  assert.deepEqual([-6, -0.01, 12.34].map(depthAtWords), [english["point.outside"], "0.0 mm", "12.3 mm"]);
});

test("a slice of the acquired plane tells its image and series, in both languages", () => {
  speak("en", english as Words);
  const of = (volume: Partial<ReadyCase["volume"]>): ReadyCase => ({
    ...SHOWN,
    volume: { ...SHOWN.volume, ...volume },
  });
  // 50 slices from −35 mm on, 2 mm apart; the lowest was acquired last.
  const images = [{ slice: 1, count: 50, number: 50, step: -1 }];
  const shown = of({ series_number: 3, images });
  assert.equal(imageWords(shown, "axial", [0, 0, -35]), "image 50 of 50, series 3");
  assert.equal(imageWords(shown, "axial", [0, 0, -33.9]), "image 49 of 50, series 3");
  assert.equal(imageWords(shown, "axial", [0, 0, 63]), "image 1 of 50, series 3");
  assert.equal(imageWords(shown, "coronal", [0, 0, -35]), "", "another plane");
  assert.equal(imageWords(shown, "axial", [0, 0, 70]), "", "beside the volume");
  assert.equal(imageWords(SHOWN, "axial", [0, 0, -35]), "", "nothing is known");
  assert.equal(imageWords(of({ images }), "axial", [0, 0, -35]), "image 50 of 50");
  // The third slice is interpolated, and the numbers do not begin at 1.
  const gap = [
    { slice: 1, count: 2, number: 101, step: 1 },
    { slice: 4, count: 47, number: 104, step: 1 },
  ];
  const words = [-33, -31, -29].map((z) => imageWords(of({ images: gap }), "axial", [0, 0, z]));
  assert.deepEqual(words, ["image 102", "", "image 104"]);
  const turned = (degrees: number): ReadyCase => {
    const [sin, cos] = [Math.sin, Math.cos].map((one) => one((degrees * Math.PI) / 180)) as [number, number];
    const patient_from_voxel = [
      [1, 0, 0, -50],
      [0, cos, -2 * sin, -50],
      [0, sin, 2 * cos, -35],
      [0, 0, 0, 1],
    ] as const;
    return of({ images, patient_from_voxel });
  };
  assert.equal(imageWords(turned(4), "axial", [0, -50, -35]), "image 50 of 50");
  assert.equal(imageWords(turned(6), "axial", [0, -50, -35]), "");
  speak("pt-BR", portuguese as Words);
  assert.equal(imageWords(shown, "axial", [0, 0, -35]), "imagem 50 de 50, série 3");
  speak("en", english as Words);
});

test("a scale bar is a round length that fits", () => {
  assert.deepEqual(scaleBar(0.5, 150), { mm: 50, pixels: 100 });
  assert.equal(scaleBar(0.001, 1).mm, 1);
});

test("the server is asked for the state's own picture", () => {
  const state = {
    ...firstState(SHOWN),
    orientation: NAMED_VIEWS.right,
    depth_mm: 8.5,
    zoom: 2,
    pan_mm: [3, -4],
    way: "exact",
    slab_mm: 1,
  } as const;
  assert.equal(
    renderQuery(state, [640, 480]).toString(),
    "depth_mm=8.5&view=right&zoom=2&pan=3%2C-4&window=400%2C600&slab_mm=1&ambient=0.3" +
      "&renderer=trace&width=640&height=480",
  );
  assert.equal(
    sliceQuery(state, "coronal", [1, 2, 3], [64, 64]).toString(),
    "position_mm=2&depth_mm=8.5&window=400%2C600&width=64&height=64",
  );
  const mesh = renderQuery({ ...state, way: "mesh" }, [64, 64]);
  assert.deepEqual(
    ["renderer", "contours", "points"].map((name) => mesh.get(name)),
    ["mesh", "80", "50"],
  );
  const oblique = renderQuery({ ...state, orientation: [0.5, 0.5, 0.5, 0.5000001] }, [64, 64]);
  assert.equal(oblique.get("view"), null);
  assert.equal(oblique.get("orientation")?.split(",").length, 4);
});

test("a picture is as large as the pane's pixels, up to a limit", () => {
  assert.deepEqual(pictureSize([500, 400], 2, 2000), [1000, 800]);
  assert.deepEqual(pictureSize([500, 400], 2, 500), [500, 400]);
  assert.deepEqual(pictureSize([0, 0], 1, 500), [16, 16]);
});

test("the cube's front face is that of the view", () => {
  for (const [name, orientation] of Object.entries(NAMED_VIEWS)) {
    const front = facesOf(orientation).filter((face) => face.frontal > 0.5);
    assert.deepEqual(
      front.map((face) => face.name),
      [name],
    );
    assert.ok(Math.hypot(...(front[0]?.middle ?? [9, 9])) < 1e-6);
  }
});
