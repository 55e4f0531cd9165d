// The outline of the brain mask on a slice.

import { svg } from "../base/dom.ts";
import type { Sphere } from "../model/case.ts";
import { type MaskBlock, axesAcross, maskOutline } from "../model/mask.ts";
import { type SliceView, slicePixel } from "../model/slice-geometry.ts";
import { type Vec2, type Vec3, transform, PLANES } from "../model/space.ts";

export class MaskLayer {
  readonly #path = svg("path", { "vector-effect": "non-scaling-stroke" });
  readonly element = svg("svg", { class: "mask-outline", "aria-hidden": "true", hidden: true }, this.#path);
  readonly #mask: MaskBlock;
  #drawn = "";

  constructor(mask: MaskBlock) {
    this.#mask = mask;
  }

  /** `isShown`: outlines are not hidden. */
  show(view: SliceView, sphere: Sphere, isShown: boolean): void {
    const mask = this.#mask;
    this.element.toggleAttribute("hidden", !isShown);
    if (!isShown) return;
    const { axis } = PLANES[view.plane];
    const drawn = `${axis} ${view.position_mm}`;
    if (drawn !== this.#drawn) this.#path.setAttribute("d", maskOutline(mask, axis, view.position_mm));
    this.#drawn = drawn;
    const [across, along] = axesAcross(axis);
    const pixel = (column: number, row: number): Vec2 => {
      const voxel = [0, 1, 2].map((one) => (one === across ? column : one === along ? row : 0)) as unknown as Vec3;
      return slicePixel(view, sphere, transform(mask.patient_from_voxel, voxel));
    };
    const [origin, right, down] = [pixel(0, 0), pixel(1, 0), pixel(0, 1)];
    const columns = [right, down].flatMap((end) => [end[0] - origin[0], end[1] - origin[1]]);
    this.#path.setAttribute("transform", `matrix(${[...columns, ...origin].join(" ")})`);
  }
}
