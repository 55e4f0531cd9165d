// The surfaces of a case: that of the whole brain, and those of its parts.

import type { View } from "./camera.ts";
import type { Sphere } from "./case.ts";
import { rotate, subtract } from "./space.ts";

/** Left and right are the halves of the cerebrum, closed along the falx; the cerebrum is without cerebellum and brain stem. */
export const SURFACES = ["whole", "left", "right", "cerebrum"] as const;
export type SurfaceName = (typeof SURFACES)[number];
export type PartName = Exclude<SurfaceName, "whole">;

export const isPart = (name: SurfaceName): name is PartName => name !== "whole";

export const isHalf = (name: SurfaceName): name is "left" | "right" => name === "left" || name === "right";

/** The surface of the mirrored places: of a half, the other half. */
export const mirroredSurface = (name: SurfaceName): SurfaceName =>
  isHalf(name) ? (name === "left" ? "right" : "left") : name;

export const nextSurface = (name: SurfaceName): SurfaceName =>
  SURFACES[(SURFACES.indexOf(name) + 1) % SURFACES.length] ?? "whole";

/**
 * The view for which the server draws a part as `view` shows it: the page keeps the head where it is, whichever surface is shown,
 * but the server fits each surface's own sphere into the picture.
 */
export function fitted<V extends View>(view: V, whole: Sphere, part: Sphere): V {
  const apart = subtract(part.center_in_patient, whole.center_in_patient);
  const [right, up] = rotate(view.orientation, apart);
  return {
    ...view,
    zoom: (view.zoom * part.radius_mm) / whole.radius_mm,
    pan_mm: [view.pan_mm[0] + right, view.pan_mm[1] + up],
  };
}
