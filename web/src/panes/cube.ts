// The orientation cube: which way the head looks, and a way to turn it: each face is a named view.

import { VIEW_NAMES, type ViewName, towardsViewer } from "../model/camera.ts";
import { svg } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { type Quat, type Vec3, cross, dot, rotate } from "../model/space.ts";

/** The outward direction of each face, LPS. */
const OUTWARD: Readonly<Record<ViewName, Vec3>> = {
  left: [1, 0, 0],
  right: [-1, 0, 0],
  anterior: [0, -1, 0],
  posterior: [0, 1, 0],
  superior: [0, 0, 1],
  inferior: [0, 0, -1],
};
const HALF = 15;
/** How far a face is turned to the viewer at the least where it has a letter. */
const LEAST_FOR_LETTER = 0.34;

/** A face as it is seen: its corners, its middle and whether it is turned to the viewer. */
export interface Face {
  readonly name: ViewName;
  readonly points: string;
  readonly middle: readonly [number, number];
  /** The cosine of the angle between the face and the picture. */
  readonly frontal: number;
}

export function facesOf(orientation: Quat): Face[] {
  const towards = towardsViewer(orientation);
  return VIEW_NAMES.map((name) => {
    const outward = OUTWARD[name];
    const across: Vec3 = outward[2] !== 0 ? [1, 0, 0] : [0, 0, 1];
    const along = cross(outward, across);
    const seen = (a: number, b: number): Vec3 =>
      rotate(
        orientation,
        [0, 1, 2].map(
          (i) => HALF * ((outward[i] ?? 0) + a * (across[i] ?? 0) + b * (along[i] ?? 0)),
        ) as unknown as Vec3,
      );
    const corners = [seen(-1, -1), seen(1, -1), seen(1, 1), seen(-1, 1)];
    const [x, y] = seen(0, 0);
    return {
      name,
      points: corners.map((corner) => `${corner[0].toFixed(1)},${(-corner[1]).toFixed(1)}`).join(" "),
      middle: [x, -y],
      frontal: dot(outward, towards),
    };
  });
}

export class Cube {
  /** A picture for the mouse; the same views are buttons of the panel. */
  readonly element = svg("svg", { class: "cube", viewBox: "-30 -30 60 60", "aria-hidden": "true" });

  #shown: Quat | null = null;

  constructor(choose: (name: ViewName) => void) {
    this.element.addEventListener("click", (event) => {
      const name =
        event.target instanceof Element ? event.target.closest("[data-view]")?.getAttribute("data-view") : null;
      const view = VIEW_NAMES.find((one) => one === name);
      if (view) choose(view);
    });
  }

  show(orientation: Quat): void {
    if (orientation === this.#shown) return;
    this.#shown = orientation;
    const faces = facesOf(orientation).filter((face) => face.frontal > 0.02);
    this.element.replaceChildren(
      ...faces.map(({ name, points, middle, frontal }) =>
        svg(
          "g",
          { "data-view": name, opacity: (0.35 + 0.65 * frontal).toFixed(2) },
          svg("title", {}, t(`view.${name}`)),
          svg("polygon", { points }),
          // On a narrow face the letter would reach over its edge, and be cut off by the next.
          frontal < LEAST_FOR_LETTER
            ? null
            : svg("text", { x: middle[0].toFixed(1), y: middle[1].toFixed(1) }, (name[0] ?? "").toUpperCase()),
        ),
      ),
    );
  }
}
